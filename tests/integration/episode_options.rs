//! Where episodes begin and end on several topics: by a field, a flag, a marker or a pause.

use coact::model::RecordingStatus;
use serde_json::{Value, json};

use crate::support::reading::{read, read_split};
use crate::support::recording_builder::RecordingBuilder;

const TOPICS: &str = "--action /act:v --state /obs:v";

/// Twenty steps on `/act` with states on `/obs`, one each ten nanoseconds, with what `also` adds.
fn with(fields: impl Fn(u64) -> Value, also: impl Fn(&mut RecordingBuilder)) -> Vec<u8> {
    let mut b = RecordingBuilder::new();
    also(&mut b);
    for i in 0..20 {
        b.json("/obs", i * 10, &json!({"v": [i]}));
        let mut message = fields(i);
        message["v"] = json!([i]);
        b.json("/act", i * 10 + 1, &message);
    }
    b.finish()
}

fn none(_: u64) -> Value {
    json!({})
}

#[test]
fn a_field_says_which_episode_it_is() {
    let read = |bytes: &[u8], rule: &str| read(bytes, &format!("{TOPICS} --episodes {rule}"));
    let by_number = with(|i| json!({"run": 40 + i / 8}), |_| ());
    let reading = read(&by_number, "field:/act:run");
    assert_eq!(reading.sizes(), [8, 8, 4]);
    let ids: Vec<i64> = reading.episodes.iter().map(|e| e.key.episode).collect();
    assert_eq!(ids, [40, 41, 42]);
    assert_eq!(reading.row.episode_rule.as_deref(), Some("field:/act:run"));

    // Interleaved, as text, two levels deep.
    let by_text = with(|i| json!({"env": {"id": format!("e{}", i % 3)}}), |_| ());
    let reading = read(&by_text, "field:/act:env.id");
    assert_eq!(reading.sizes(), [7, 7, 6]);
    assert_eq!(reading.episodes[1].key.episode_id.as_deref(), Some("e1"));
    assert_eq!(reading.episodes[1].key.episode, 1);
    assert_eq!(reading.episodes[1].actions.column(0)[..3], [1.0, 4.0, 7.0]);

    // On a topic of its own, written behind all else; nothing is known before the first.
    let elsewhere = |b: &mut RecordingBuilder| {
        b.json("/run", 131, &json!({"id": "b"}));
        b.json("/run", 51, &json!({"id": "a"}));
    };
    let reading = read(&with(none, elsewhere), "field:/run:id");
    let ids: Vec<_> = reading
        .episodes
        .iter()
        .map(|e| e.key.episode_id.as_deref().unwrap_or(""))
        .collect();
    assert_eq!((ids, reading.sizes()), (vec!["a", "b"], vec![8, 7]));
    assert_eq!(reading.refused("episode is missing"), 5);
    assert_eq!(reading.row.n_messages, 42);
}

#[test]
fn an_id_that_is_not_there_is_said() {
    let missing = |b: &mut RecordingBuilder| {
        b.json("/run", 0, &json!({"id": 1}));
        b.json("/run", 101, &json!({"other": 2}));
    };
    let reading = read(
        &with(none, missing),
        &format!("{TOPICS} --episodes field:/run:id"),
    );
    assert_eq!(reading.sizes(), [20]);
    assert_eq!(reading.refused("episode is missing"), 1);

    let mistyped = read(
        &with(none, |_| ()),
        &format!("{TOPICS} --episodes field:/act:idd"),
    );
    assert_eq!(mistyped.row.status, RecordingStatus::Failed);
    assert!(
        mistyped.error().contains("is missing"),
        "{}",
        mistyped.error()
    );
}

#[test]
fn a_flag_ends_an_episode_on_its_own_topic_or_on_another() {
    let same = with(|i| json!({"over": i == 6, "done": i == 3}), |_| ());
    let reading = read(&same, &format!("{TOPICS} --episodes done:/act:over"));
    assert_eq!(reading.sizes(), [7, 13]);

    // At the time of an action the flag ends the episode behind it; false flags and repeated ones change nothing.
    let other = |b: &mut RecordingBuilder| {
        for (time, over) in [(150, true), (61, true), (62, true), (63, false), (5, true)] {
            b.json("/reset", time, &json!({"over": over}));
        }
    };
    let reading = read(
        &with(none, other),
        &format!("{TOPICS} --episodes done:/reset:over"),
    );
    assert_eq!(reading.sizes(), [1, 6, 8, 5]);
    assert_eq!(reading.row.n_messages, 45);
    assert_eq!(reading.row.n_messages_refused, 0);
}

#[test]
fn a_flag_that_is_not_there_is_said() {
    // A name mistyped must not make one episode of all.
    let bytes = with(|i| json!({"done": i == 6}), |_| ());
    let reading = read(&bytes, &format!("{TOPICS} --episodes done:/act:dome"));
    assert_eq!(reading.sizes(), [0], "{:?}", reading.row);
    assert!(reading.reason(0).contains("is missing"));
    let native = |flag: &str| {
        let mut b = RecordingBuilder::new();
        for i in 0..20 {
            b.step(&json!({"action": i, "state": i, "over": i == 6}));
        }
        read(&b.finish(), &format!("--episodes done:/step:{flag}"))
    };
    assert_eq!(native("over").sizes(), [7, 13]);
    assert_eq!(native("ovre").sizes(), [0]);

    let other = |b: &mut RecordingBuilder| {
        b.json("/reset", 61, &json!({"over": true}));
        b.json("/reset", 101, &json!({"oven": true}));
    };
    let reading = read(
        &with(none, other),
        &format!("{TOPICS} --episodes done:/reset:over"),
    );
    assert_eq!(reading.sizes(), [7, 13]);
    assert_eq!(reading.row.n_messages_refused, 1);
    // Null is how some say that there is no flag for a step.
    let null = with(
        |i| {
            if i == 6 {
                json!({"over": true})
            } else {
                json!({"over": null})
            }
        },
        |_| (),
    );
    let reading = read(&null, &format!("{TOPICS} --episodes done:/act:over"));
    assert_eq!(reading.sizes(), [7, 13], "{:?}", reading.row);
}

#[test]
fn a_marker_begins_an_episode() {
    let marks = |times: &'static [u64]| {
        move |b: &mut RecordingBuilder| {
            for &time in times {
                b.message_at("/new", "whatever", time, b"\xff");
            }
        }
    };
    let read = |times| {
        read(
            &with(none, marks(times)),
            &format!("{TOPICS} --episodes marker:/new"),
        )
    };
    // At the time of an action it comes before it; out of order in the file; two in a row are one.
    let reading = read(&[151, 49, 51, 50, 150]);
    assert_eq!(reading.sizes(), [10, 5]);
    assert_eq!(reading.refused("before the first marker"), 5);
    assert_eq!(reading.actions(0)[0], 5.0);
    assert!(reading.row.causes.iter().all(|c| c.expected));
    assert_eq!(read(&[0]).sizes(), [20]);
    assert_eq!(read(&[500]).row.status, RecordingStatus::Failed);
    assert!(read(&[]).error().contains("no message on topic \"/new\""));
}

#[test]
fn a_bad_action_before_the_first_marker_or_state_is_no_episode_and_spoils_none() {
    let bad = |b: &mut RecordingBuilder| {
        b.json("/act", 0, &json!({"v": "text"}));
        b.json("/new", 51, &json!({}));
    };
    let reading = read(
        &with(none, bad),
        &format!("{TOPICS} --episodes marker:/new"),
    );
    assert_eq!((reading.sizes(), reading.reason(0)), (vec![15], ""));
    assert_eq!(reading.row.n_messages_refused, 6);

    for rule in ["auto", "recording", "gap:1"] {
        let mut b = RecordingBuilder::new();
        b.json("/act", 0, &json!({"v": [0]}))
            .json("/act", 1, &json!({"v": "text"}))
            .json("/act", 2, &json!({"v": [2]}))
            .json("/obs", 3, &json!({"v": [0]}));
        for i in 4..20 {
            b.json("/act", i, &json!({"v": [i]}));
        }
        let reading = read(&b.finish(), &format!("{TOPICS} --episodes {rule}"));
        assert_eq!(reading.sizes(), [16], "{rule}: {:?}", reading.row);
        assert_eq!(reading.reason(0), "", "{rule}");
        assert_eq!(reading.refused("before the first state"), 2, "{rule}");
        assert_eq!(reading.row.n_messages_refused, 3, "{rule}");
    }
}

#[test]
fn a_pause_begins_an_episode_if_it_is_longer_than_asked() {
    let mut b = RecordingBuilder::new();
    b.json("/obs", 0, &json!({"v": [0]}));
    let times = [10, 110, 210, 311, 411, 410, 600];
    for (i, time) in times.into_iter().enumerate() {
        b.json("/act", time, &json!({"v": [time], "step": 90 + i % 4}));
    }
    let bytes = b.finish();
    let plain = format!("{TOPICS} --episodes gap:0.0000001");
    let reading = read(&bytes, &plain);
    assert_eq!(reading.episodes.len(), 3);
    assert_eq!(reading.sizes()[0], 3);
    // Step numbers order the second: 93 (311), then 91 (410) and 90 (411).
    assert_eq!(reading.episodes[1].actions.column(0)[..2], [411.0, 410.0]);
    assert!(reading.reason(1).contains("92 is missing"));

    // Of one topic alone, and out of order.
    let mut b = RecordingBuilder::new();
    for time in [500, 0, 100, 601, 400, 200] {
        b.json("/m", time, &json!({"a": [time], "s": [time]}));
    }
    let bytes = b.finish();
    let flags = "--action /m:a --state /m:s --episodes";
    assert_eq!(
        read(&bytes, &format!("{flags} gap:0.0000001")).sizes(),
        [3, 2, 1]
    );
    assert_eq!(
        read(&bytes, &format!("{flags} gap:0.000000099")).sizes(),
        [1; 6]
    );
    assert_eq!(read(&bytes, &format!("{flags} gap:0.0000002")).sizes(), [6]);
}

#[test]
fn what_is_asked_for_comes_before_what_messages_say() {
    // Ids, flags and numbers are all there.
    let fields = |i: u64| json!({"episode": i / 5, "done": i % 4 == 3, "step": i});
    let bytes = with(fields, |b| {
        b.json("/new", 100, &json!({}));
        b.json("/new", 0, &json!({}));
    });
    let sizes = |rule: &str| read(&bytes, &format!("{TOPICS} --episodes {rule}")).sizes();
    assert_eq!(sizes("recording"), [20]);
    assert_eq!(sizes("marker:/new"), [10, 10]);
    assert_eq!(sizes("done:/act:done"), [4; 5]);
    assert_eq!(sizes("gap:1"), [20]);
    // An id that ends by its flag is closed: the step behind it is refused.
    assert_eq!(sizes("auto"), [4, 3, 2, 1]);
    let reading = read(&bytes, TOPICS);
    assert_eq!(
        reading.row.episode_rule.as_deref(),
        Some("field:/act:episode")
    );
    assert_eq!(reading.refused("closed"), 10);
}

#[test]
fn a_bad_action_ends_its_episode_and_a_bad_state_is_left_out() {
    for bad in [
        "garbage",
        r#"{"v":[NaN]}"#,
        r#"{"v":[]}"#,
        r#"{"v":[1,2]}"#,
        "{}",
    ] {
        for topic in ["/act", "/obs"] {
            let mut b = RecordingBuilder::new();
            for i in 0..20 {
                for at in ["/obs", "/act"] {
                    if i == 9 && at == topic {
                        b.message_at(at, "json", i * 10, bad.as_bytes());
                    } else {
                        b.json(at, i * 10, &json!({"v": [i]}));
                    }
                }
            }
            b.json("/new", 0, &json!({})).json("/new", 150, &json!({}));
            let reading = read(&b.finish(), &format!("{TOPICS} --episodes marker:/new"));
            if topic == "/act" {
                assert_eq!(reading.sizes(), [9, 5], "{bad}");
                assert_ne!(reading.reason(0), "", "{bad}");
                assert_eq!(reading.episodes[0].n_dropped_steps, 6, "{bad}");
                assert_eq!(reading.row.n_messages_refused, 6, "{bad}");
            } else {
                assert_eq!(reading.sizes(), [15, 5], "{bad}");
                assert_eq!(reading.reason(0), "", "{bad}");
                assert_eq!(reading.row.n_messages_refused, 1, "{bad}");
                assert_eq!(reading.states(0)[8..11], [8.0, 8.0, 10.0], "{bad}");
            }
            assert_eq!(reading.reason(1), "", "{bad}");
        }
    }
}

#[test]
fn a_bad_step_says_which_episode_it_belongs_to() {
    // Interleaved: the bad action of one leaves the other as it is.
    let mut b = RecordingBuilder::new();
    for i in 0..40u64 {
        b.json("/obs", i * 10, &json!({"v": [i]}));
        let v = if i == 20 { json!([null]) } else { json!([i]) };
        let message = json!({"episode": i % 2, "step": i / 2, "v": v});
        b.json("/act", i * 10 + 1, &message);
    }
    let reading = read(&b.finish(), TOPICS);
    assert_eq!(reading.sizes(), [10, 20]);
    assert_eq!(
        (reading.reason(1), reading.row.n_messages_refused),
        ("", 10)
    );
}

#[test]
fn step_numbers_order_what_time_does_not() {
    // The clock of the recorder stood still; numbers fall where positions rise.
    let mut b = RecordingBuilder::new();
    b.json("/obs", 0, &json!({"v": [0]}));
    for i in 0..20 {
        b.json("/act", 7, &json!({"v": [i], "step": 20 - i}));
    }
    let reading = read(&b.finish(), TOPICS);
    let expected: Vec<f64> = (0..20).rev().map(f64::from).collect();
    assert_eq!((reading.actions(0), reading.reason(0)), (expected, ""));
}

#[test]
fn one_topic_may_be_the_clock_and_hold_the_state_of_another_too() {
    // Actions and half of the state on one topic, the other half on another.
    let mut b = RecordingBuilder::new();
    for i in 0..20u64 {
        b.json("/m", i * 10, &json!({"a": [i], "s": [i + 100]}));
        b.json("/obs", i * 10 + 5, &json!({"v": [i + 200]}));
    }
    let bytes = b.finish();
    let reading = read(&bytes, "--action /m:a --state /obs:v --state /m:s");
    let expected: Vec<f64> = (1..20).map(f64::from).collect();
    let add = |n: f64| expected.iter().map(|v| v + n).collect::<Vec<_>>();
    assert_eq!(reading.actions(0), expected);
    assert_eq!(
        (reading.states(0), reading.states(1)),
        (add(199.0), add(100.0))
    );
    assert_eq!(reading.row.n_messages_refused, 1);
}

#[test]
fn a_marker_on_a_chosen_topic_counts_once() {
    let mut b = RecordingBuilder::new();
    for i in 0..20 {
        b.json("/obs", i * 10, &json!({"v": [i]}));
        b.json("/act", i * 10 + 1, &json!({"v": [i]}));
    }
    let bytes = b.finish();
    for (topic, align) in [("/obs", "before"), ("/act", "before"), ("/obs", "index")] {
        let flags = format!("{TOPICS} --episodes marker:{topic} --align {align}");
        let reading = read(&bytes, &flags);
        assert_eq!(reading.sizes(), [1; 20], "{topic}");
        assert_eq!(
            (reading.row.n_messages, reading.row.n_messages_refused),
            (40, 0),
            "{topic}"
        );
    }
}

#[test]
fn a_recording_of_several_files_is_aligned_across_them() {
    let part = |range: std::ops::Range<u64>| {
        let mut b = RecordingBuilder::new();
        for i in range {
            // States lag behind: the state of a step may stand in the next file.
            b.json("/act", i * 10 + 5, &json!({"v": [i]}));
            if i >= 3 {
                b.json("/obs", (i - 3) * 10, &json!({"v": [i - 3]}));
            }
        }
        b.finish()
    };
    let files = [part(0..10), part(10..20), part(20..33)];
    let files: Vec<Option<&[u8]>> = files.iter().map(|f| Some(f.as_slice())).collect();
    for align in ["before", "nearest"] {
        let reading = read_split(&files, &format!("{TOPICS} --align {align}"));
        assert_eq!(reading.actions(0)[..30], reading.states(0)[..30], "{align}");
        assert_eq!(reading.row.n_messages, 63, "{align}");
    }
}
