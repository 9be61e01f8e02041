//! The method against exact results of an independent program (`tests/golden/*.json`).
//!
//! A mask is a string of 0 and 1; `?` is either (a tie that the authors' arithmetic decides by its last bit), and what
//! depends on one is null. The four published episodes hold what the authors printed.

use coact::extraction::{ExtractionParams, RawParams, extract};
use coact::model::{Episode, Extraction, JointMode, Outcome};
use serde_json::Value;

use crate::support::{episodes, project};

/// Agreement asked of `E_w`: relative, or absolute near zero.
const MEASURE_RELATIVE: f64 = 1e-10;
const MEASURE_ABSOLUTE: f64 = 1e-13;
/// Agreement asked of `E_n` and of sums of it.
const CHANGE_ABSOLUTE: f64 = 1e-9;

fn params_of(case: &Value) -> ExtractionParams {
    let number = |key: &str| case[key].as_u64().map(|n| usize::try_from(n).unwrap());
    ExtractionParams::new(RawParams {
        measure: case["measure"].as_str().unwrap().parse().unwrap(),
        profile: serde_json::from_value(case["profile"].clone()).unwrap(),
        bins: number("bins").unwrap(),
        window: number("window").unwrap(),
        threshold: case["threshold"].as_f64().unwrap(),
        joints: if case["joints"] == "together" {
            JointMode::Together
        } else {
            JointMode::Each
        },
        order: number("order"),
        tolerance: case["tolerance"].as_f64(),
    })
    .unwrap()
}

#[track_caller]
fn check_mask(label: &str, found: &[bool], expected: &Value) {
    let Some(expected) = expected.as_str() else {
        return;
    };
    assert_eq!(found.len(), expected.len(), "{label}");
    for (t, (found, expected)) in found.iter().zip(expected.chars()).enumerate() {
        assert!(
            expected == '?' || *found == (expected == '1'),
            "{label}: step {t} is {found}, expected {expected}"
        );
    }
}

#[track_caller]
fn check_series(label: &str, found: &[f64], expected: &Value, relative: f64, absolute: f64) {
    let Some(expected) = expected.as_array() else {
        return;
    };
    assert_eq!(found.len(), expected.len(), "{label}");
    for (t, (x, y)) in found
        .iter()
        .zip(expected.iter().map(|y| y.as_f64().unwrap()))
        .enumerate()
    {
        assert!(
            (x - y).abs() <= absolute.max(relative * y.abs()),
            "{label}: step {t} is {x:e}, expected {y:e}"
        );
    }
}

/// Compares one case; the number of comparisons that the golden file allowed.
fn check_case(label: &str, case: &Value, found: &Extraction) -> usize {
    check_mask(
        &format!("{label} state_mask"),
        &found.state.mask,
        &case["state_mask"],
    );
    check_series(
        &format!("{label} state_measure"),
        &found.state.measure,
        &case["state_measure"],
        MEASURE_RELATIVE,
        MEASURE_ABSOLUTE,
    );
    check_series(
        &format!("{label} state_change"),
        &found.state.change,
        &case["state_change"],
        0.0,
        CHANGE_ABSOLUTE,
    );
    assert_eq!(
        found.joints.len(),
        case["action_mask"].as_array().unwrap().len(),
        "{label}: joints"
    );
    let mut compared = 0;
    for (k, joint) in found.joints.iter().enumerate() {
        let label = format!("{label} joint {k}");
        check_mask(
            &format!("{label} action_mask"),
            &joint.action.mask,
            &case["action_mask"][k],
        );
        check_mask(
            &format!("{label} correlated"),
            &joint.correlated,
            &case["correlated"][k],
        );
        check_series(
            &format!("{label} action_measure"),
            &joint.action.measure,
            &case["action_measure"][k],
            MEASURE_RELATIVE,
            MEASURE_ABSOLUTE,
        );
        check_series(
            &format!("{label} action_change"),
            &joint.action.change,
            &case["action_change"][k],
            0.0,
            CHANGE_ABSOLUTE,
        );
        if let Some(expected) = case["boundaries"][k].as_array() {
            let expected: Vec<usize> = expected
                .iter()
                .map(|b| usize::try_from(b.as_u64().unwrap()).unwrap())
                .collect();
            assert_eq!(joint.boundaries, expected, "{label}: boundaries");
            compared += 1;
        }
        if let Some(expected) = case["segments"][k].as_array() {
            let spans: Vec<_> = joint
                .segments
                .iter()
                .map(|s| (s.start_step as u64, s.end_step as u64))
                .collect();
            let wanted: Vec<_> = expected
                .iter()
                .map(|s| (s[0].as_u64().unwrap(), s[1].as_u64().unwrap()))
                .collect();
            assert_eq!(spans, wanted, "{label}: segments");
            for (segment, expected) in joint.segments.iter().zip(expected) {
                if let Some(sum) = expected[2].as_f64() {
                    assert!(
                        (segment.state_change_sum - sum).abs()
                            <= CHANGE_ABSOLUTE * sum.abs().max(1.0),
                        "{label}: {segment:?}, expected {sum}"
                    );
                }
            }
            compared += 1;
        }
    }
    compared
}

/// Runs every case of one golden file; (cases, comparisons of boundaries and segments).
fn check_file(name: &str, recordings: &str) -> (usize, usize) {
    let text = std::fs::read_to_string(project(&format!("tests/golden/{name}.json"))).unwrap();
    let golden: Value = serde_json::from_str(&text).unwrap();
    let recorded = episodes(&project(&format!(
        "{recordings}/{}",
        golden["recording"].as_str().unwrap()
    )));
    let (mut n_cases, mut compared) = (0, 0);
    for expected in golden["episodes"].as_array().unwrap() {
        let id = expected["episode"].as_i64().unwrap();
        let episode: &Episode = recorded.iter().find(|e| e.key.episode == id).unwrap();
        if expected["status"] == "too_short" {
            assert!(matches!(
                extract(
                    episode,
                    &ExtractionParams::new(RawParams::default()).unwrap()
                ),
                Outcome::TooShort { min_steps: 11 }
            ));
            n_cases += 1;
            continue;
        }
        for case in expected["cases"].as_array().unwrap() {
            let params = params_of(case);
            let label = format!(
                "{name} episode {id} {} {} w={}",
                case["profile"], case["measure"], case["window"]
            );
            let Outcome::Extracted(found) = extract(episode, &params) else {
                panic!("{label}: too short")
            };
            compared += check_case(&label, case, &found);
            n_cases += 1;
        }
    }
    (n_cases, compared)
}

#[test]
fn edge_cases_of_the_arithmetic() {
    assert_eq!(check_file("synthetic", "tests/golden/recordings").0, 165);
}

#[test]
fn the_published_episodes_are_reproduced() {
    for name in ["a147", "b200", "c169", "d200"] {
        let (n_cases, compared) = check_file(
            &format!("published_cartpole_{name}"),
            "tests/golden/recordings",
        );
        assert_eq!(n_cases, 7, "{name}");
        assert!(compared >= 4, "{name}: {compared} comparisons");
    }
}

#[test]
fn real_episodes() {
    let names = [
        "cartpole",
        "mountaincar",
        "pendulum",
        "acrobot",
        "boxing_ram",
        "breakout_ram",
        "pong_ram",
        "tennis_ram",
        "skiing_ram",
        "pong_gray",
        "halfcheetah",
        "fetch_pickandplace",
    ];
    let (n_cases, compared) = names
        .iter()
        .map(|n| check_file(n, "fixtures/recordings"))
        .fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    assert!(
        n_cases >= 200 && compared >= 300,
        "{n_cases} cases, {compared} comparisons"
    );
}
