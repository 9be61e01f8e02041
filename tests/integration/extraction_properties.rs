//! The method against its naive version on random input, and what must hold of any result.

use std::sync::Arc;

use coact::extraction::{ExtractionParams, Measure, Profile, RawParams, extract};
use coact::model::{Columns, Episode, EpisodeKey, Extraction, JointMode, Outcome};
use proptest::prelude::*;

use crate::support::naive;

/// How a column of random values looks.
#[derive(Debug, Clone, Copy)]
enum Shape {
    Uniform,
    FewIntegers,
    Constant,
    Huge,
    Subnormal,
    OnEdges,
    Steps,
    NarrowOnLarge,
}

const SHAPES: [Shape; 8] = [
    Shape::Uniform,
    Shape::FewIntegers,
    Shape::Constant,
    Shape::Huge,
    Shape::Subnormal,
    Shape::OnEdges,
    Shape::Steps,
    Shape::NarrowOnLarge,
];

fn column(shape: Shape, seed: u64, n: usize) -> Vec<f64> {
    let mut state = seed | 1;
    let mut next = || {
        // xorshift64*: enough for test data, and the same everywhere.
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..n)
        .map(|t| {
            let u = next();
            match shape {
                Shape::Uniform => u * 2.0 - 1.0,
                Shape::FewIntegers => (u * 5.0).floor(),
                Shape::Constant => 3.25,
                Shape::Huge => (u * 2.0 - 1.0) * f64::MAX,
                Shape::Subnormal => (u * 40.0).floor() * 5e-324,
                Shape::OnEdges => (u * 64.0).floor() / 64.0,
                Shape::Steps => ((t / 9) % 4) as f64,
                Shape::NarrowOnLarge => 1e15 + (u * 8.0).floor() * 0.125,
            }
        })
        .collect()
}

fn episode(actions: &[Vec<f64>], states: &[Vec<f64>]) -> Episode {
    let n = actions[0].len();
    Episode {
        key: EpisodeKey {
            recording: Arc::from("r.mcap"),
            episode: 0,
            episode_id: None,
        },
        env_id: None,
        actions: Columns::new(n, actions.to_vec()),
        states: Columns::new(n, states.to_vec()),
        joint_names: None,
        times: None,
        rewards: None,
        incomplete: None,
        n_dropped_steps: 0,
    }
}

prop_compose! {
    fn columns(max: usize)(shapes in prop::collection::vec(0..SHAPES.len(), 1..=max), seed in any::<u64>()) -> Vec<(Shape, u64)> {
        shapes.iter().enumerate().map(|(i, &s)| (SHAPES[s], seed.wrapping_add(1 + i as u64 * 7919))).collect()
    }
}

prop_compose! {
    fn raw_params()(
        measure in 0usize..8,
        authors in any::<bool>(),
        bins in prop_oneof![Just(2usize), Just(3), Just(64), Just(100), Just(65_536), 2usize..300],
        window in prop_oneof![2usize..=9, 10usize..=20, 30usize..=40],
        threshold in prop_oneof![Just(0.0), Just(0.5), 0.0..0.99],
        together in any::<bool>(),
        order in prop::option::of(1usize..=6),
        tolerance in prop::option::of(prop_oneof![Just(0.0), 0.0..0.3]),
    ) -> RawParams {
        let measure = Measure::ALL[measure];
        RawParams {
            measure,
            profile: if authors { Profile::Authors } else { Profile::Paper },
            bins,
            window,
            threshold,
            joints: if together { JointMode::Together } else { JointMode::Each },
            order: order.filter(|_| measure.default_order().is_some()),
            tolerance: tolerance.filter(|_| measure.has_tolerance()),
        }
    }
}

/// Agreement of two ways to compute the same sum.
fn assert_close(label: &str, fast: &[f64], slow: &[f64]) {
    assert_eq!(fast.len(), slow.len());
    for (t, (f, s)) in fast.iter().zip(slow).enumerate() {
        assert!(f.is_finite(), "{label}: step {t} is {f}");
        assert!(
            (f - s).abs() <= 1e-13f64.max(1e-10 * s.abs()),
            "{label}: step {t} is {f:e}, naive {s:e}"
        );
    }
}

/// Every stage from the measures on, held against the stage before.
fn check_stages(raw: &RawParams, found: &Extraction) {
    for joint in &found.joints {
        let correlated = naive::correlated(&joint.action.mask, &found.state.mask, raw);
        assert_eq!(joint.correlated, correlated);
        let (boundaries, segments) = naive::partition(&correlated, raw.profile);
        assert_eq!(joint.boundaries, boundaries);
        let spans: Vec<_> = joint
            .segments
            .iter()
            .map(|s| (s.start_step, s.end_step))
            .collect();
        assert_eq!(spans, segments);
        assert!(
            spans.windows(2).all(|pair| pair[0].1 <= pair[1].0),
            "segments are sorted and disjoint"
        );
        let mut ranks: Vec<_> = joint.segments.iter().map(|s| s.state_change_rank).collect();
        ranks.sort_unstable();
        assert_eq!(ranks, (1..=segments.len()).collect::<Vec<_>>());
        for (series, name) in [(&joint.action, "action"), (&found.state, "state")] {
            assert!(
                series.change.iter().all(|c| (0.0..=1.0).contains(c)),
                "{name} change is in 0..=1"
            );
            let limit = if raw.profile == Profile::Paper {
                raw.threshold + 1e-9
            } else {
                raw.threshold
            };
            let constant = series.change.iter().all(|c| *c == 0.0);
            for (change, mask) in series.change.iter().zip(&series.mask) {
                let passes = if raw.profile == Profile::Paper {
                    *change > limit
                } else {
                    *change >= limit
                };
                assert!(
                    *mask == passes || (!mask && constant),
                    "{name}: change {change}, mask {mask}, λ {}",
                    raw.threshold
                );
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn fast_equals_naive(raw in raw_params(), actions in columns(3), states in columns(5), extra in prop_oneof![Just(0usize), 0usize..80]) {
        let Ok(params) = ExtractionParams::new(raw) else { return Ok(()) };
        let n = params.min_steps() + extra;
        let data = |shapes: &[(Shape, u64)]| shapes.iter().map(|&(shape, seed)| column(shape, seed, n)).collect::<Vec<_>>();
        let (actions, states) = (data(&actions), data(&states));
        let Outcome::Extracted(found) = extract(&episode(&actions, &states), &params) else { panic!("long enough") };
        assert_close("state", &found.state.measure, &naive::pooled_measure(&states, &raw));
        match raw.joints {
            JointMode::Each => {
                for (joint, column) in found.joints.iter().zip(&actions) {
                    assert_close("action", &joint.action.measure, &naive::joint_measure(column, &raw));
                }
            }
            JointMode::Together => assert_close("actions", &found.joints[0].action.measure, &naive::pooled_measure(&actions, &raw)),
        }
        check_stages(&raw, &found);
    }

    #[test]
    fn one_step_less_is_too_short(raw in raw_params()) {
        let Ok(params) = ExtractionParams::new(raw) else { return Ok(()) };
        let n = params.min_steps() - 1;
        let data = [column(Shape::Uniform, 1, n)];
        prop_assert_eq!(extract(&episode(&data, &data), &params), Outcome::TooShort { min_steps: n + 1 });
    }

    #[test]
    fn divergences_are_bounded(shapes in columns(4), bins in 2usize..200, window in 2usize..12) {
        let states: Vec<_> = shapes.iter().map(|&(shape, seed)| column(shape, seed, 80)).collect();
        let bounds = [(Measure::JensenShannon, std::f64::consts::LN_2), (Measure::TotalVariation, 1.0), (Measure::EarthMover, 1.0)];
        for (measure, most) in bounds {
            let params = ExtractionParams::new(RawParams { measure, bins, window, ..RawParams::default() }).unwrap();
            let Outcome::Extracted(found) = extract(&episode(&states[..1], &states), &params) else { panic!("long enough") };
            prop_assert!(found.state.measure.iter().all(|&e| (0.0..=most + 1e-12).contains(&e)));
            prop_assert!(found.state.measure.contains(&0.0), "a border window equals the one it repeats");
        }
    }

    #[test]
    fn a_constant_state_column_changes_nothing_in_profile_paper(raw in raw_params(), states in columns(4)) {
        let raw = RawParams { profile: Profile::Paper, ..raw };
        let Ok(params) = ExtractionParams::new(raw) else { return Ok(()) };
        let n = params.min_steps() + 30;
        let mut states: Vec<_> = states.iter().map(|&(shape, seed)| column(shape, seed, n)).collect();
        let actions = [column(Shape::Steps, 1, n)];
        let before = extract(&episode(&actions, &states), &params);
        states.insert(0, vec![7.0; n]);
        prop_assert_eq!(before, extract(&episode(&actions, &states), &params));
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let states: Vec<_> = (0..200)
        .map(|i| column(SHAPES[i % SHAPES.len()], 17 + i as u64, 150))
        .collect();
    let actions = [column(Shape::Uniform, 3, 150), column(Shape::Steps, 4, 150)];
    let episode = episode(&actions, &states);
    for measure in Measure::ALL {
        for profile in [Profile::Paper, Profile::Authors] {
            let params = ExtractionParams::new(RawParams {
                measure,
                profile,
                ..RawParams::default()
            })
            .unwrap();
            let run = |threads| {
                rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap()
                    .install(|| extract(&episode, &params))
            };
            let one = run(1);
            assert_eq!(one, run(2), "{measure}");
            assert_eq!(one, run(5), "{measure}");
        }
    }
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    #[track_caller]
    fn check(change: impl Fn(&mut RawParams), word: &str) {
        let mut raw = RawParams::default();
        change(&mut raw);
        let error = ExtractionParams::new(raw).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
    check(|r| r.bins = 1, "bins is 1");
    check(|r| r.bins = 65_537, "bins is 65537");
    check(|r| r.window = 1, "window is 1");
    check(|r| r.window = 1025, "window is 1025");
    check(|r| r.threshold = 1.0, "threshold is 1");
    check(|r| r.threshold = f64::NAN, "threshold is NaN");
    check(|r| r.order = Some(3), "earth-mover has none");
    check(|r| r.tolerance = Some(0.1), "earth-mover has none");
    check(
        |r| (r.measure, r.order) = (Measure::Sample, Some(17)),
        "order is 17",
    );
    check(
        |r| (r.measure, r.order) = (Measure::Sample, Some(4)),
        "needs at least 6",
    );
    check(
        |r| (r.measure, r.window) = (Measure::Permutation, 2),
        "needs at least 3",
    );
    check(
        |r| (r.measure, r.tolerance) = (Measure::Sample, Some(-0.1)),
        "tolerance is -0.1",
    );
}
