//! Several topics on the clock of the actions: which state a step gets, which steps there are, and that every message is
//! accounted for. Random recordings are held against a slow, obvious reference.

use coact::model::RecordingStatus;
use serde_json::json;

use crate::support::messages::{JOINT_STATE, MULTI_ARRAY, joint_state, multi_array};
use crate::support::reading::{Dice, Reading, read};
use crate::support::recording_builder::{Layout, RecordingBuilder};

const SECOND: u64 = 1_000_000_000;

const TOPICS: &str = "--action /act:v --state /obs:v";

/// A message of a random recording; its value is unique.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sent {
    topic: &'static str,
    time: u64,
    value: f64,
}

fn write(messages: &[Sent]) -> Vec<u8> {
    let mut b = RecordingBuilder::new();
    for m in messages {
        b.json(m.topic, m.time, &json!({"v": [m.value]}));
    }
    b.finish()
}

/// Messages of one topic in the order of time, equal times as in the file.
fn of_topic(messages: &[Sent], topic: &str) -> Vec<Sent> {
    let mut of: Vec<Sent> = messages
        .iter()
        .copied()
        .filter(|m| m.topic == topic)
        .collect();
    of.sort_by_key(|m| m.time);
    of
}

/// The state that counts for the `nth` action.
fn state_of(states: &[Sent], nth: usize, time: u64, align: &str) -> Option<Sent> {
    let before = states.iter().rev().find(|s| s.time <= time).copied();
    let after = states.iter().find(|s| s.time > time).copied();
    match align {
        "before" => before,
        "index" => states.get(nth).copied(),
        _ => match (before, after) {
            (Some(b), Some(a)) if a.time - time < time - b.time => Some(a),
            (Some(b), _) => Some(b),
            (None, after) => after,
        },
    }
}

/// What a reading must give: action and states of each step, and counts of what is refused.
#[derive(Debug, Default, PartialEq)]
struct Expected {
    steps: Vec<Vec<f64>>,
    before_first: u64,
    too_old: u64,
    no_index: u64,
    left: u64,
}

fn expected(messages: &[Sent], topics: &[&str], align: &str, max_age: Option<u64>) -> Expected {
    let actions = of_topic(messages, "/act");
    let others: Vec<Vec<Sent>> = topics.iter().map(|t| of_topic(messages, t)).collect();
    let mut expected = Expected::default();
    for (nth, action) in actions.iter().enumerate() {
        let found: Option<Vec<Sent>> = others
            .iter()
            .map(|states| state_of(states, nth, action.time, align))
            .collect();
        match found {
            None if align == "index" => expected.no_index += 1,
            None => expected.before_first += 1,
            Some(states)
                if max_age.is_some_and(|age| {
                    states.iter().any(|s| s.time.abs_diff(action.time) > age)
                }) =>
            {
                expected.too_old += 1;
            }
            Some(states) => {
                let values = states.iter().map(|s| s.value);
                let step = std::iter::once(action.value).chain(values).collect();
                expected.steps.push(step);
            }
        }
    }
    if align == "index" {
        for states in &others {
            let n = states.len().saturating_sub(actions.len()) as u64;
            expected.left += if n > 1 { n } else { 0 };
        }
    }
    expected
}

fn found(reading: &Reading) -> Expected {
    let steps = reading.episodes.iter().flat_map(|e| {
        (0..e.n_steps()).map(|i| {
            let columns = e.actions.iter().chain(e.states.iter());
            columns.map(|c| c[i]).collect::<Vec<_>>()
        })
    });
    Expected {
        steps: steps.collect(),
        before_first: reading.refused("before the first state"),
        too_old: reading.refused("--max-age"),
        no_index: reading.refused("no state of its index"),
        left: reading.refused("state without an action"),
    }
}

/// A recording with topics of different rates, times that repeat, in an order of the file that is none.
fn random(dice: &mut Dice, topics: &[&'static str]) -> Vec<Sent> {
    let mut value = 0.0;
    let mut messages = Vec::new();
    for &topic in topics {
        let n = 1 + dice.below(40);
        // Few different times, so that many are equal.
        let (from, span) = (dice.below(30), 1 + dice.below(120));
        for _ in 0..n {
            value += 1.0;
            messages.push(Sent {
                topic,
                time: from + dice.below(span),
                value,
            });
        }
    }
    match dice.below(4) {
        0 => dice.shuffle(&mut messages),
        1 => messages.sort_by_key(|m| m.time),
        2 => messages.reverse(),
        // Topic after topic.
        _ => {}
    }
    messages
}

#[test]
fn every_alignment_is_as_the_obvious_one_on_random_recordings() {
    for seed in 0..400 {
        let mut dice = Dice(seed);
        let topics: &[&str] = match seed % 4 {
            0 => &["/act", "/obs", "/obs2"],
            1 => &["/obs", "/act"],
            2 => &["/act", "/act2", "/obs"],
            _ => &["/act", "/obs"],
        };
        let messages = random(&mut dice, topics);
        // Columns come out as actions, then states.
        let (others, flags): (&[&str], _) = match seed % 4 {
            0 => (
                &["/obs2", "/obs"],
                "--action /act:v --state /obs2:v --state /obs:v",
            ),
            2 => (
                &["/act2", "/obs"],
                "--action /act:v --action /act2:v --state /obs:v",
            ),
            _ => (&["/obs"], TOPICS),
        };
        let age = (dice.below(3) == 0).then(|| dice.below(20));
        for align in ["before", "nearest", "index"] {
            let young = age.map_or(String::new(), |age| format!(" --max-age 0.{age:09}"));
            let flags = format!("{flags} --align {align} --episodes recording{young}");
            let reading = read(&write(&messages), &flags);
            let expected = expected(&messages, others, align, age);
            let context = format!("seed {seed}: {flags}\n{messages:?}\n{:?}", reading.row);
            assert_eq!(found(&reading), expected, "{context}");
            assert_eq!(reading.row.n_messages, messages.len() as u64, "{context}");
            let n_refused =
                expected.before_first + expected.too_old + expected.no_index + expected.left;
            assert_eq!(reading.row.n_messages_refused, n_refused, "{context}");
        }
    }
}

/// `n` actions every second from second 1, each half a second after its state.
fn pairs(n_actions: u64, n_states: u64) -> RecordingBuilder {
    let mut b = RecordingBuilder::new();
    for i in 0..n_actions.max(n_states) {
        let time = (i + 1) * SECOND;
        if i < n_states {
            b.json("/obs", time - SECOND / 2, &json!({"v": [i]}));
        }
        if i < n_actions {
            b.json("/act", time, &json!({"v": [i]}));
        }
    }
    b
}

#[test]
fn zipping_takes_one_state_more_and_says_what_does_not_pair() {
    let flags = format!("{TOPICS} --align index");
    let one_more = read(&pairs(20, 21).finish(), &flags);
    assert_eq!((one_more.sizes(), one_more.reason(0)), (vec![20], ""));
    assert_eq!(one_more.row.n_messages_refused, 0);
    assert_eq!(one_more.row.n_messages_used, 41);

    let one_less = read(&pairs(20, 19).finish(), &flags);
    assert_eq!(one_less.sizes(), [19]);
    assert!(one_less.reason(0).contains("no state of its index"));
    assert_eq!(one_less.row.n_messages_refused, 1);

    let two_more = read(&pairs(20, 22).finish(), &flags);
    assert_eq!(two_more.sizes(), [20]);
    assert_eq!(two_more.refused("state without an action"), 2);
}

#[test]
fn zipping_never_shifts_where_a_message_cannot_be_read() {
    for (topic, bad) in [
        ("/obs", json!({"v": ["text"]})),
        ("/obs", json!({"v": [1, 2]})),
        ("/obs", json!({})),
        ("/act", json!({"v": [null]})),
        ("/act", json!({"v": [1, 2]})),
    ] {
        let mut b = RecordingBuilder::new();
        for i in 0..20 {
            let good = json!({"v": [i]});
            for at in ["/obs", "/act"] {
                let message = if i == 8 && at == topic { &bad } else { &good };
                b.json(at, (i + 1) * SECOND, message);
            }
        }
        let reading = read(&b.finish(), &format!("{TOPICS} --align index"));
        assert_eq!(reading.actions(0), reading.states(0), "{topic} {bad}");
        assert_eq!(reading.sizes(), [8], "{topic} {bad}");
        assert!(!reading.reason(0).is_empty(), "{topic} {bad}");
    }
}

#[test]
fn zipping_never_shifts_behind_a_lost_chunk() {
    // Step numbers go on, since only states are lost.
    let mut b = RecordingBuilder::with_layout(Layout {
        compression: None,
        chunk_size: 600,
        ..Layout::default()
    });
    for i in 0..30 {
        b.json("/obs", (i + 1) * SECOND, &json!({"v": [i], "pad": "state"}));
    }
    for i in 0..30 {
        let message = json!({"v": [i], "step": i});
        b.json("/act", (i + 1) * SECOND, &message);
    }
    let mut bytes = b.finish();
    let at = find(&bytes, br#""pad":"state","v":[12]"#);
    bytes[at] ^= 1;
    let reading = read(
        &bytes,
        &format!("{TOPICS} --align index --episodes recording"),
    );
    assert_eq!(reading.row.status, RecordingStatus::Recovered);
    assert_eq!(reading.actions(0), reading.states(0));
    assert!(reading.sizes().iter().sum::<usize>() < 13);
}

fn find(bytes: &[u8], text: &[u8]) -> usize {
    bytes.windows(text.len()).position(|w| w == text).unwrap()
}

#[test]
fn an_age_holds_in_both_directions_to_the_nanosecond() {
    let mut b = RecordingBuilder::new();
    for (topic, time) in [
        ("/obs", 1_000),
        ("/act", 1_100),
        ("/act", 1_101),
        ("/act", 1_899),
        ("/act", 1_900),
        ("/obs", 2_000),
    ] {
        b.json(topic, time, &json!({"v": [time]}));
    }
    let bytes = b.finish();
    let read = |align| {
        read(
            &bytes,
            &format!("{TOPICS} --max-age 0.0000001 --align {align}"),
        )
    };
    let before = read("before");
    assert_eq!(before.actions(0), [1_100.0]);
    assert_eq!(before.refused("--max-age"), 3);
    assert_eq!(before.episodes[0].n_dropped_steps, 3);
    let nearest = read("nearest");
    assert_eq!(nearest.actions(0), [1_100.0, 1_900.0]);
    assert_eq!(nearest.states(0), [1_000.0, 2_000.0]);
    // A step left out is no bad step.
    assert_eq!(
        (nearest.reason(0), nearest.episodes[0].n_dropped_steps),
        ("", 2)
    );
}

#[test]
fn joints_that_come_one_by_one_are_as_old_as_the_oldest_and_as_near_as_the_latest() {
    let mut b = RecordingBuilder::new();
    for i in 0..20u64 {
        let name = ["a", "b"][(i % 2) as usize];
        b.json("/obs", i * 10, &json!({"name": [name], "position": [i]}));
    }
    for i in 2..18 {
        b.json("/act", i * 10 + 1, &json!({"v": [i]}));
    }
    let bytes = b.finish();
    let topics = "--action /act:v --state /obs:position[a] --state /obs:position[b]";
    for align in ["before", "nearest"] {
        let reading = read(&bytes, &format!("{topics} --align {align}"));
        let latest: Vec<f64> = (2..18).map(|i| f64::from(i / 2 * 2)).collect();
        assert_eq!(reading.states(0), latest, "{align}");
        let latest: Vec<f64> = (2..18).map(|i| f64::from((i - 1) / 2 * 2 + 1)).collect();
        assert_eq!(reading.states(1), latest, "{align}");
        let young = read(
            &bytes,
            &format!("{topics} --align {align} --max-age 0.000000011"),
        );
        assert_eq!(young.sizes(), [16], "{align}");
        let old = read(
            &bytes,
            &format!("{topics} --align {align} --max-age 0.00000001"),
        );
        assert_eq!(old.refused("--max-age"), 16, "{align}");
    }
}

#[test]
fn a_step_left_out_still_ends_its_episode() {
    let mut b = RecordingBuilder::new();
    b.json("/obs", 0, &json!({"v": [0]}));
    for i in 0..8u64 {
        b.json("/act", i * 10, &json!({"v": [i], "done": i == 3}));
        if i != 2 {
            b.json("/obs", i * 10 + 5, &json!({"v": [i]}));
        }
    }
    let reading = read(&b.finish(), &format!("{TOPICS} --max-age 0.000000005"));
    assert_eq!(reading.refused("--max-age"), 1);
    assert_eq!(reading.sizes(), [3, 4], "{:?}", reading.row);
    assert_eq!(reading.episodes[0].n_dropped_steps, 1);
}

#[test]
fn each_clock_takes_its_own_time() {
    // By the log the state of i comes before action i, by publishing one later, by the header two later.
    let mut b = RecordingBuilder::new();
    let schema = (JOINT_STATE.0, JOINT_STATE.1, JOINT_STATE.2);
    let states = b.channel("/obs", "cdr", Some(schema));
    let actions = b.channel("/act", "json", None);
    for i in 0..20u64 {
        let log = (i + 10) * SECOND;
        let stamp = log - 5 * SECOND + 2 * SECOND;
        b.send(
            states,
            log,
            5 * SECOND - SECOND,
            &joint_state(stamp, &["j"], &[i as f64]),
        );
        let stamp = json!({"sec": i + 5, "nanosec": 7});
        let message = json!({"v": [i], "header": {"stamp": stamp}}).to_string();
        b.send(actions, log + 7, 5 * SECOND, message.as_bytes());
    }
    let bytes = b.finish();
    for (clock, late) in [("log", 0), ("publish", 1), ("header", 2)] {
        let flags = format!("--action /act:v --state /obs:position --clock {clock}");
        let reading = read(&bytes, &flags);
        let expected: Vec<f64> = (0..20 - late).map(f64::from).collect();
        assert_eq!(reading.states(0), expected, "{clock}");
        assert_eq!(reading.actions(0)[0], f64::from(late), "{clock}");
        assert_eq!(
            reading.refused("before the first state"),
            late as u64,
            "{clock}"
        );
        let times = reading.episodes[0].times.as_ref().unwrap();
        let first = (if clock == "log" { 10 } else { 5 } + i64::from(late)) * SECOND as i64 + 7;
        assert_eq!(times[0], first, "{clock}");
        assert_eq!(reading.row.clock.as_deref(), Some(clock));
    }
}

#[test]
fn a_message_without_a_stamp_has_no_place_on_the_header_clock() {
    let stamped = |i: u64, has_stamp: bool| {
        if has_stamp {
            json!({"action": [i], "state": [i], "header": {"stamp": {"sec": i + 100, "nanosec": 0}}})
        } else {
            json!({"action": [i], "state": [i]})
        }
    };
    // Each message a step by itself, and with a state of another topic.
    for flags in [
        "--action /m:action --state /m:state",
        "--action /m:action --state /obs:state",
    ] {
        let mut b = RecordingBuilder::new();
        for i in 0..20 {
            b.json("/obs", i, &stamped(i, true));
            b.json("/m", i, &stamped(i, i != 12));
        }
        let reading = read(&b.finish(), &format!("{flags} --clock header"));
        assert_eq!(reading.sizes(), [12], "{flags}: {:?}", reading.row);
        assert!(reading.reason(0).contains("time"), "{flags}");
        let expected: Vec<f64> = (0..12).map(f64::from).collect();
        assert_eq!(reading.actions(0), expected, "{flags}");
        // A state without one is refused, no more.
        let mut b = RecordingBuilder::new();
        for i in 0..20 {
            b.json("/obs", i, &stamped(i, i != 12));
            b.json("/act", i, &stamped(i, true));
        }
        let flags = "--action /act:action --state /obs:state --clock header";
        let reading = read(&b.finish(), flags);
        assert_eq!(reading.sizes(), [20], "{:?}", reading.row);
        assert_eq!(reading.row.n_messages_refused, 1);
        assert_eq!(reading.states(0)[11..14], [11.0, 11.0, 13.0]);
    }
    let mut b = RecordingBuilder::new();
    b.json("/m", 0, &json!({"action": 1, "state": 1}));
    let none = read(
        &b.finish(),
        "--action /m:action --state /m:state --clock header",
    );
    assert!(none.error().contains("--clock header"), "{}", none.error());
}

#[test]
fn a_time_beyond_what_a_timestamp_holds_is_a_bad_step() {
    let mut b = RecordingBuilder::new();
    for i in 0..20u64 {
        let time = if i == 12 { u64::MAX } else { i };
        b.json("/m", time, &json!({"action": [i], "state": [i]}));
    }
    let reading = read(&b.finish(), "--action /m:action --state /m:state");
    assert_eq!(reading.sizes(), [12], "{:?}", reading.row);
    assert!(reading.reason(0).contains("time"), "{}", reading.reason(0));
}

/// A recording of wide vectors, larger than what is held back to put messages in order: 38 MiB of values a topic.
fn wide(order: &str) -> Vec<u8> {
    const WIDTH: usize = 24_000;
    const N: u64 = 200;
    let mut b = RecordingBuilder::new();
    let states = b.channel("/obs", "cdr", Some(MULTI_ARRAY));
    let actions = b.channel("/act", "cdr", Some(MULTI_ARRAY));
    let markers = b.channel("/new", "json", None);
    let state = |b: &mut RecordingBuilder, i: u64| {
        let values: Vec<f64> = (0..WIDTH).map(|c| (i + c as u64) as f64).collect();
        b.send(states, i * 10, 0, &multi_array(&values));
    };
    let action = |b: &mut RecordingBuilder, i: u64| {
        let values: Vec<f64> = (0..WIDTH).map(|c| i as f64 * 0.5 + c as f64).collect();
        b.send(actions, i * 10 + 1, 0, &multi_array(&values));
    };
    match order {
        "in order" => {
            for i in 0..N {
                if i.is_multiple_of(50) {
                    b.send(markers, i * 10, 0, b"{}");
                }
                state(&mut b, i);
                action(&mut b, i);
            }
        }
        "states first" => {
            (0..N).for_each(|i| state(&mut b, i));
            (0..N).for_each(|i| action(&mut b, i));
        }
        _ => {
            (0..N).for_each(|i| action(&mut b, i));
            (0..N).for_each(|i| state(&mut b, i));
        }
    }
    b.finish()
}

#[test]
fn more_than_is_held_back_reads_as_less_does() {
    let topics = "--action /act:data --state /obs:data";
    let expected: Vec<f64> = (0..200).map(f64::from).collect();
    for (order, all_flags) in [
        (
            "in order",
            &[
                "--episodes marker:/new",
                "--align nearest --episodes gap:1",
                "--align index --episodes gap:1",
            ][..],
        ),
        // One episode: all of it is held back, whatever comes first in the file.
        ("states first", &["--episodes auto"]),
        ("actions first", &["--align index --episodes recording"]),
    ] {
        let bytes = wide(order);
        for flags in all_flags {
            let reading = read(&bytes, &format!("{topics} {flags}"));
            let context = format!("{order} {flags}: {:?}", reading.row);
            assert_eq!(reading.states(0), expected, "{context}");
            assert_eq!(reading.row.n_messages_refused, 0, "{context}");
            let n_episodes = if flags.contains("marker") { 4 } else { 1 };
            assert_eq!(reading.episodes.len(), n_episodes, "{context}");
            let last: Vec<f64> = expected.iter().map(|v| v + 23_999.0).collect();
            assert_eq!(reading.states(23_999), last, "{context}");
        }
    }
}

#[test]
fn what_comes_later_than_is_held_back_is_refused_and_counted() {
    let bytes = wide("states first");
    let reading = read(
        &bytes,
        "--action /act:data --state /obs:data --episodes gap:1",
    );
    let n_late = reading.refused("further out of the order of time");
    assert!(n_late > 0 && n_late < 200, "{:?}", reading.row);
    assert_eq!(reading.row.n_messages_refused, n_late);
    // What is used pairs rightly.
    let expected: Vec<f64> = reading.actions(0).iter().map(|a| a * 2.0).collect();
    assert_eq!(reading.states(0), expected);
}
