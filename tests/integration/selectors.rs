//! What a selector takes out of a message, and in which order: fields, joints by name, joints that come and go.

use serde_json::{Value, json};

use crate::support::reading::{Dice, Reading, columns, read, rising};
use crate::support::recording_builder::{RecordingBuilder, step_message};

/// JSON messages of `/obs`, in order, each behind one action.
fn states(messages: &[Value]) -> Vec<u8> {
    let mut b = RecordingBuilder::new();
    for (i, message) in (0..).zip(messages) {
        b.json("/obs", i * 10, message);
        b.json("/act", i * 10 + 1, &json!({"v": [i]}));
    }
    b.finish()
}

fn read_states(messages: &[Value], selectors: &[&str]) -> Reading {
    let quoted = selectors.iter().map(|s| format!(" --state '/obs:{s}'"));
    let flags = format!("--action /act:v{}", quoted.collect::<Vec<_>>().concat());
    read(&states(messages), &flags)
}

#[test]
fn a_selector_takes_what_it_says_in_the_order_it_says() {
    let message = |i: u64| {
        json!({
            "z": {"b": [i, [i + 1, true]], "a": i + 2},
            "list": [i + 10, i + 11, i + 12, i + 13],
            "odd.key": {"x:y": i + 20},
            "name": ["p", "q"],
            "position": [i + 30, i + 31],
            "joints": [{"name": "u", "q": i + 40}, {"name": "w", "q": i + 41}],
        })
    };
    // Members in another order later on, and in objects too.
    let other = json!({
        "joints": [{"q": 42, "name": "w"}, {"q": 41, "name": "u"}],
        "position": [32, 31],
        "name": ["q", "p"],
        "odd.key": {"x:y": 21},
        "list": [11, 12, 13, 14],
        "z": {"a": 3, "b": [1, [2, true]]},
    });
    let messages = [message(0), other, message(2)];
    let check = |selectors: &[&str], expected: &[f64]| {
        let reading = read_states(&messages, selectors);
        assert_eq!(reading.sizes(), [3], "{selectors:?}: {:?}", reading.row);
        let first: Vec<f64> = columns(&reading).iter().map(|c| c[0]).collect();
        assert_eq!(first, expected, "{selectors:?}");
        for column in columns(&reading) {
            let is_flag = column == [1.0; 3];
            assert!(
                is_flag || column == rising(3, column[0]),
                "{selectors:?}: {column:?}"
            );
        }
    };
    // Members of an object come in the order of the first message, which is that of the alphabet here.
    check(&["z"], &[2.0, 0.0, 1.0, 1.0]);
    check(&["z.a", "z.b"], &[2.0, 0.0, 1.0, 1.0]);
    check(&["z.b[1]"], &[1.0, 1.0]);
    check(&["list"], &[10.0, 11.0, 12.0, 13.0]);
    check(&["list[3]", "list[0..2]"], &[13.0, 10.0, 11.0]);
    check(
        &["list[1..3]", "list[2]", "list"],
        &[11.0, 12.0, 12.0, 10.0, 11.0, 12.0, 13.0],
    );
    check(&["[\"odd.key\"][\"x:y\"]"], &[20.0]);
    check(&["position"], &[30.0, 31.0]);
    check(&["position[q]"], &[31.0]);
    check(
        &["position[q]", "position[p]", "position[q]"],
        &[31.0, 30.0, 31.0],
    );
    check(&["joints.q"], &[40.0, 41.0]);
    check(&["joints[w].q", "joints.q[u]", "z.a"], &[41.0, 40.0, 2.0]);

    let refused = |selector: &str, words: &str| {
        let reading = read_states(&messages, &[selector]);
        let said = format!("{} {:?}", reading.error(), reading.row.causes);
        assert!(said.contains(words), "{selector}: {said}");
    };
    refused("list[3..9]", "fewer values");
    refused("list[9]", "state is missing");
    refused("nothing", "state is missing");
    refused(
        "nothing",
        "(fields of /obs: joints, list, name, odd.key, position, z)",
    );
    refused("name", "text where a number");
    refused(
        "list[shoulder]",
        "no message names \"shoulder\", they name p, q",
    );
    refused("position[elbow]", "no message names \"elbow\"");
    let nameless = read_states(&[json!({"list": [1, 2]})], &["list[shoulder]"]);
    assert!(
        nameless.error().contains("picks by name"),
        "{}",
        nameless.error()
    );
}

#[test]
fn joints_are_ordered_by_name_whatever_the_message_says() {
    let joints = |names: &[&str], i: u64| {
        let value = |n: &&str| (i as f64) + f64::from(n.as_bytes()[0] - b'a') * 100.0;
        let position: Vec<f64> = names.iter().map(value).collect();
        json!({"name": names, "position": position})
    };
    let mut dice = Dice(5);
    let mut messages = Vec::new();
    for i in 0..40 {
        let mut names = ["b", "d", "a", "c"];
        if i > 0 {
            dice.shuffle(&mut names);
        }
        messages.push(joints(&names, i));
    }
    let reading = read_states(&messages, &["position"]);
    let expected: Vec<_> = [100.0, 300.0, 0.0, 200.0].map(|by| rising(40, by)).into();
    assert_eq!(columns(&reading), expected);

    // One joint is lacking in a message, then one is too many, then one is named twice.
    for (names, is_bad) in [
        (vec!["b", "d", "a"], true),
        (vec!["c", "b", "e", "d", "a"], false),
        (vec!["b", "d", "a", "a"], true),
        (vec!["b", "d"], true),
        (vec![], true),
    ] {
        let mut messages = messages.clone();
        messages[20] = joints(&names, 20);
        let reading = read_states(&messages, &["position"]);
        assert_eq!(
            reading.row.n_messages_refused,
            u64::from(is_bad),
            "{names:?}"
        );
        let mut expected = expected.clone();
        if is_bad {
            for column in &mut expected {
                column[20] = column[19];
            }
        }
        assert_eq!(columns(&reading), expected, "{names:?}: {:?}", reading.row);
    }
    // Names that do not go with the values.
    let mut messages = messages.clone();
    messages[20] = json!({"name": ["a", "b", "c", "d"], "position": [1, 2, 3]});
    let reading = read_states(&messages, &["position"]);
    assert_eq!(reading.refused("as many names as values"), 1);
}

#[test]
fn joints_of_the_action_are_ordered_and_named() {
    let mut b = RecordingBuilder::new();
    b.metadata(&[("action_names", r#"["x","y"]"#)]);
    for i in 0..20u64 {
        b.json("/obs", i * 10, &json!({"v": [i]}));
        let (names, values) = match i % 2 {
            0 => (["lift", "turn"], [i, i + 100]),
            _ => (["turn", "lift"], [i + 100, i]),
        };
        let message = json!({"name": names, "position": values});
        b.json("/act", i * 10 + 1, &message);
        b.json("/bare", i * 10 + 1, &json!({"two": [i, i], "one": [i]}));
    }
    let bytes = b.finish();
    let read = |action: &str| read(&bytes, &format!("--state /obs:v {action}"));
    let by_name = read("--action /act:position");
    assert_eq!(by_name.joint_names(), ["lift", "turn"]);
    assert_eq!(
        (by_name.actions(0), by_name.actions(1)),
        (rising(20, 0.0), rising(20, 100.0))
    );
    let picked = read("--action /act:position[turn] --action /act:position[lift]");
    assert_eq!(picked.joint_names(), ["turn", "lift"]);
    assert_eq!(picked.actions(0), rising(20, 100.0));
    // Where messages name nothing the metadata does, if it names as many.
    assert_eq!(read("--action /bare:two").joint_names(), ["x", "y"]);
    assert_eq!(read("--action /bare:one").joint_names(), [""; 0]);
    assert_eq!(read("--action '/bare:two[1..2]'").joint_names(), ["y"]);
    let swapped = read("--action '/bare:two[1]' --action '/bare:two[0]'");
    assert_eq!(swapped.joint_names(), ["y", "x"]);
    // Too many names for this array: which is whose cannot be told.
    assert_eq!(read("--action '/bare:one[0]'").joint_names(), [""; 0]);
    // The same message alone, its names ordering the action.
    let alone =
        crate::support::reading::read(&bytes, "--action /act:position[turn] --state /act:position");
    assert_eq!(
        (alone.actions(0), alone.states(1)),
        (rising(20, 100.0), rising(20, 100.0))
    );
}

#[test]
fn a_joint_that_is_lacking_in_an_action_is_a_bad_step() {
    let mut b = RecordingBuilder::new();
    for i in 0..20u64 {
        b.json("/obs", i * 10, &json!({"v": [i]}));
        let message = if i == 12 {
            json!({"name": ["a"], "position": [i]})
        } else {
            json!({"name": ["a", "b"], "position": [i, i]})
        };
        b.json("/act", i * 10 + 1, &message);
    }
    let reading = read(&b.finish(), "--action /act:position --state /obs:v");
    assert_eq!(reading.sizes(), [12]);
    assert!(reading.reason(0).contains("lacks a joint"));
}

#[test]
fn joints_shared_out_among_messages_hold_their_latest_value() {
    // Arm and gripper by turns, the gripper first; the whole never comes at once.
    let mut messages = Vec::new();
    for i in 0..20 {
        messages.push(match i % 2 {
            0 => json!({"name": ["grip"], "position": [i]}),
            _ if i % 4 == 1 => json!({"name": ["lift", "turn"], "position": [i, 100 + i]}),
            _ => json!({"name": ["turn", "lift"], "position": [100 + i, i]}),
        });
    }
    let held = |from: usize, by: f64| {
        let value = |i: usize| (i - (i + from) % 2) as f64 + by;
        (1..20).map(value).collect::<Vec<_>>()
    };
    for selectors in [
        &["position"][..],
        &["position[grip]", "position[lift]", "position[turn]"],
    ] {
        let reading = read_states(&messages, selectors);
        let expected = [held(0, 0.0), held(1, 0.0), held(1, 100.0)];
        assert_eq!(columns(&reading), expected, "{:?}", reading.row);
        // The first action comes before arm and gripper were seen.
        assert_eq!(reading.refused("before the first state"), 1);
        assert_eq!(reading.row.n_messages_refused, 1);
    }
    // One joint is wanted: the others do not matter.
    let reading = read_states(&messages, &["position[grip]"]);
    assert_eq!(
        reading.states(0),
        (0..20).map(|i| f64::from(i / 2 * 2)).collect::<Vec<_>>()
    );
    // One that never comes is mistyped: the error lists those that do.
    let reading = read_states(&messages, &["position[grip]", "position[wrist]"]);
    let words = "no message names \"wrist\", they name grip, lift, turn";
    assert!(reading.error().contains(words), "{:?}", reading.row);
    // The same on the clock: each action holds the other joints.
    let mut b = RecordingBuilder::new();
    b.json("/obs", 0, &json!({"v": [0]}));
    for (i, message) in (0..).zip(&messages) {
        b.json("/act", i * 10, message);
    }
    let reading = read(&b.finish(), "--action /act:position --state /obs:v");
    let expected = [held(0, 0.0), held(1, 0.0), held(1, 100.0)];
    assert_eq!([0, 1, 2].map(|j| reading.actions(j)), expected);
    assert_eq!(reading.joint_names(), ["grip", "lift", "turn"]);
    assert_eq!(reading.row.n_messages_refused, 1);
}

#[test]
fn joints_in_objects_may_come_or_not() {
    let joint = |name: &str, q: Option<f64>| match q {
        Some(q) => json!({"name": name, "q": q}),
        None => json!({"name": name}),
    };
    let all = |joints: &[Value]| json!({"joints": joints});
    let messages = [
        // The first one has none at all.
        all(&[]),
        all(&[joint("a", Some(1.0)), joint("b", None)]),
        all(&[joint("b", Some(2.0)), joint("a", Some(3.0))]),
        all(&[joint("b", Some(4.0))]),
        all(&[]),
        all(&[joint("a", None), joint("b", Some(5.0))]),
    ];
    let reading = read_states(&messages, &["joints.q"]);
    assert_eq!(
        columns(&reading),
        [[3.0, 3.0, 3.0, 3.0], [2.0, 4.0, 4.0, 5.0]],
        "{:?}",
        reading.row
    );
    assert_eq!(reading.refused("state is "), 2, "{:?}", reading.row);
    assert_eq!(reading.refused("before the first state"), 2);
    let picked = read_states(&messages, &["joints[b].q"]);
    assert_eq!(picked.states(0), [2.0, 4.0, 4.0, 5.0], "{:?}", picked.row);
}

#[test]
fn a_first_message_without_names_decides_nothing() {
    let named = |names: [&str; 2], values: [f64; 2]| json!({"name": names, "position": values});
    let none: [&str; 0] = [];
    for first in [
        json!({"name": none, "position": none}),
        json!({"name": none, "position": [9, 9]}),
    ] {
        let messages = [
            first,
            named(["a", "b"], [1.0, 2.0]),
            named(["b", "a"], [4.0, 3.0]),
        ];
        let reading = read_states(&messages, &["position"]);
        assert_eq!(
            columns(&reading),
            [[1.0, 3.0], [2.0, 4.0]],
            "{:?}",
            reading.row
        );
    }
    // One whose names and values do not go together, which may be names of something else.
    let messages = [
        json!({"name": ["a", "b"], "position": [9]}),
        named(["a", "b"], [1.0, 2.0]),
        named(["b", "a"], [4.0, 3.0]),
    ];
    let reading = read_states(&messages, &["position"]);
    assert_eq!(
        columns(&reading),
        [[1.0, 3.0], [2.0, 4.0]],
        "{:?}",
        reading.row
    );
    // A trajectory without a point.
    let points = |p: Value, names: [&str; 2]| json!({"joint_names": names, "points": p});
    let messages = [
        points(json!([]), ["a", "b"]),
        points(json!([{"positions": [1, 2]}]), ["a", "b"]),
        points(json!([{"positions": [4, 3]}]), ["b", "a"]),
    ];
    let reading = read_states(&messages, &["points[0].positions"]);
    assert_eq!(
        columns(&reading),
        [[1.0, 3.0], [2.0, 4.0]],
        "{:?}",
        reading.row
    );
}

#[test]
fn other_names_behind_an_episode_that_is_out_lose_nothing_else() {
    // All in one chunk. The second episode has a message that lacks a joint, the third is as the first.
    let build = |odd: Value| {
        let mut b = RecordingBuilder::new();
        for episode in 0..3 {
            for step in 0..12 {
                let i = episode * 12 + step;
                let mut message = step_message(episode, step as usize, step == 11);
                let (names, values) = if i % 2 == 0 {
                    (["a", "b"], [i, i + 100])
                } else {
                    (["b", "a"], [i + 100, i])
                };
                message["s"] = json!({"name": names, "position": values});
                if episode == 1 && step == 5 {
                    message["s"] = odd.clone();
                }
                b.step(&message);
            }
        }
        b.finish()
    };
    for odd in [
        json!({"name": ["a"], "position": [1]}),
        json!({"name": ["a", "c"], "position": [1, 2]}),
    ] {
        let flags = "--action /step:action --state /step:s.position";
        let reading = read(&build(odd), flags);
        assert_eq!(reading.row.n_messages, 36);
        assert_eq!(reading.sizes(), [12, 5, 12], "{:?}", reading.row);
        assert!(
            reading.reason(1).contains("lacks a joint"),
            "{}",
            reading.reason(1)
        );
        let expected: Vec<f64> = (0..17).chain(24..36).map(f64::from).collect();
        assert_eq!(reading.states(0), expected);
    }
    // One more than is wanted changes nothing.
    let more = json!({"name": ["c", "b", "a"], "position": [1, 117, 17]});
    let reading = read(
        &build(more),
        "--action /step:action --state /step:s.position",
    );
    assert_eq!(reading.sizes(), [12, 12, 12], "{:?}", reading.row);
    assert_eq!(reading.states(1), rising(36, 100.0));
}
