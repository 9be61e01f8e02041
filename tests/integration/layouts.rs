//! Which topics and fields are action and state where nobody says so; recordings of several files and channels.

use std::process::Command;

use coact::model::RecordingStatus;
use serde_json::json;

use crate::support::messages::{
    JOINT_STATE, MULTI_ARRAY, TRAJECTORY, TWIST, TWIST_STAMPED, joint_state, joint_states,
    joint_states_schema, multi_array, trajectory, twist, twist_stamped,
};
use crate::support::reading::{
    Reading, columns, inspection, inspection_of_split, read, read_split, rising,
};
use crate::support::recording_builder::{Layout, RecordingBuilder, step_message};

type Schema<'a> = (&'a str, &'a str, &'a [u8]);

/// One message at each step, on every topic: what it holds is said by its number.
fn topics(topics: &[(&str, &str, Option<Schema<'_>>, &dyn Fn(u64) -> Vec<u8>)]) -> Vec<u8> {
    let mut b = RecordingBuilder::new();
    for i in 0..20 {
        for (topic, encoding, schema, message) in topics {
            let channel = b.channel(topic, encoding, *schema);
            b.send(channel, i * 10, 0, &message(i));
        }
    }
    b.finish()
}

/// Reads with what is printed and with nothing, which must be the same.
#[track_caller]
fn check_choice(bytes: &[u8], action: &[&str], state: &[&str]) -> Reading {
    let found = inspection(bytes, "");
    let choice = found.choice.as_ref().unwrap_or_else(|| panic!("{found:?}"));
    assert_eq!(
        (choice.action.as_slice(), choice.state.as_slice()),
        (
            action
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .as_slice(),
            state
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .as_slice(),
        )
    );
    let auto = read(bytes, "");
    let mut asked = read(bytes, found.flags.as_ref().unwrap());
    assert_eq!(auto.row.status, RecordingStatus::Ok, "{:?}", auto.row);
    assert!(auto.row.chosen.is_some() && asked.row.chosen.is_none());
    asked.row.chosen.clone_from(&auto.row.chosen);
    assert_eq!(auto, asked);
    assert_eq!(
        auto.row.action_selector.as_deref(),
        Some(action.join(" ").as_str())
    );
    assert_eq!(
        auto.row.state_selector.as_deref(),
        Some(state.join(" ").as_str())
    );
    auto
}

fn joints_at(i: u64) -> Vec<u8> {
    let (a, b) = (i as f64, i as f64 + 100.0);
    if i.is_multiple_of(2) {
        joint_state(0, &["a", "b"], &[a, b])
    } else {
        joint_state(0, &["b", "a"], &[b, a])
    }
}

#[test]
fn each_layout_of_the_table_is_found() {
    let joints = (
        "/joint_states",
        "cdr",
        Some(JOINT_STATE),
        &joints_at as &dyn Fn(u64) -> Vec<u8>,
    );
    let camera = ("/camera", "capnproto", None, &(|_| b"pixels".to_vec()) as _);

    let commands = |i: u64| multi_array(&[i as f64, i as f64 + 50.0]);
    let command = ("/arm/commands", "cdr", Some(MULTI_ARRAY), &commands as _);
    let reading = check_choice(
        &topics(&[camera, joints, command]),
        &["/arm/commands:data"],
        &["/joint_states:position"],
    );
    assert_eq!(
        (reading.actions(1), reading.states(1)),
        (rising(20, 50.0), rising(20, 100.0))
    );
    assert_eq!(reading.row.encoding.as_deref(), Some("cdr"));

    let goals = |i: u64| {
        let i = i as f64;
        if i as u64 % 3 == 1 {
            trajectory(&["b", "a"], &[i + 7.0, i])
        } else {
            trajectory(&["a", "b"], &[i, i + 7.0])
        }
    };
    let goal = ("/goal", "cdr", Some(TRAJECTORY), &goals as _);
    let reading = check_choice(
        &topics(&[joints, goal, camera]),
        &["/goal:points[0].positions"],
        &["/joint_states:position"],
    );
    assert_eq!(reading.joint_names(), ["a", "b"]);
    assert_eq!(
        (reading.actions(0), reading.actions(1)),
        (rising(20, 0.0), rising(20, 7.0))
    );

    let velocities = |i: u64| [0.0, 1.0, 2.0, 3.0, 4.0, 5.0].map(|v| v + i as f64);
    let twists = |i: u64| twist(velocities(i));
    let stamped = |i: u64| twist_stamped(i, velocities(i));
    let twist = ("/cmd_vel", "cdr", Some(TWIST), &twists as _);
    let reading = check_choice(
        &topics(&[joints, twist]),
        &["/cmd_vel:linear", "/cmd_vel:angular"],
        &["/joint_states:position"],
    );
    assert_eq!(
        (0..6).map(|j| reading.actions(j)[0]).collect::<Vec<_>>(),
        rising(6, 0.0)
    );
    let twist = ("/cmd_vel", "cdr", Some(TWIST_STAMPED), &stamped as _);
    let reading = check_choice(
        &topics(&[joints, twist]),
        &["/cmd_vel:twist.linear", "/cmd_vel:twist.angular"],
        &["/joint_states:position"],
    );
    assert_eq!(reading.actions(5), rising(20, 5.0));

    for word in [
        "/LEADER/joint_states",
        "/arm/command",
        "/target",
        "/robot/action",
    ] {
        let leader = (word, "cdr", Some(JOINT_STATE), &joints_at as _);
        let reading = check_choice(
            &topics(&[leader, joints, camera]),
            &[&format!("{word}:position")],
            &["/joint_states:position"],
        );
        assert_eq!(reading.joint_names(), ["a", "b"]);
    }
}

#[test]
fn joint_states_of_foxglove_are_found_in_json_and_in_protobuf() {
    let json = |i: u64| {
        let joint = |name: &str, by: u64| json!({"name": name, "position": i + by});
        let joints = match i % 3 {
            0 => json!([joint("a", 0), joint("b", 100)]),
            1 => json!([joint("b", 100), joint("a", 0)]),
            _ => json!([joint("b", 100)]),
        };
        json!({"timestamp": {"sec": 0, "nsec": i}, "joints": joints})
            .to_string()
            .into_bytes()
    };
    let binary = |i: u64| {
        let (a, b) = (("a", Some(i as f64)), ("b", Some(i as f64 + 100.0)));
        match i % 3 {
            0 => joint_states(&[a, b]),
            1 => joint_states(&[b, a]),
            _ => joint_states(&[("a", None), b]),
        }
    };
    let schema = joint_states_schema();
    let layouts: [(&str, Schema<'_>, &dyn Fn(u64) -> Vec<u8>); 2] = [
        ("json", ("foxglove.JointStates", "jsonschema", b"{}"), &json),
        (
            "protobuf",
            ("foxglove.JointStates", "protobuf", &schema),
            &binary,
        ),
    ];
    for (encoding, schema, message) in layouts {
        let leader = ("/leader", encoding, Some(schema), message);
        let follower = ("/follower", encoding, Some(schema), message);
        let bytes = topics(&[follower, leader]);
        let reading = check_choice(
            &bytes,
            &["/leader:joints.position"],
            &["/follower:joints.position"],
        );
        // What does not come holds its value.
        let held: Vec<f64> = (0..20)
            .map(|i| f64::from(if i % 3 == 2 { i - 1 } else { i }))
            .collect();
        for (a, b) in [
            (reading.actions(0), reading.actions(1)),
            (reading.states(0), reading.states(1)),
        ] {
            assert_eq!((a, b), (held.clone(), rising(20, 100.0)), "{encoding}");
        }
        assert_eq!(reading.joint_names(), ["a", "b"], "{encoding}");
    }
}

#[test]
fn the_native_convention_is_found_among_other_topics() {
    let steps = |i: u64| {
        step_message(0, i as usize, i == 19)
            .to_string()
            .into_bytes()
    };
    let command = |i: u64| multi_array(&[i as f64]);
    let bytes = topics(&[
        ("/joint_states", "cdr", Some(JOINT_STATE), &joints_at),
        ("/cmd", "cdr", Some(MULTI_ARRAY), &command),
        ("/step", "json", Some(("Step", "jsonschema", b"{}")), &steps),
        ("/log", "ros1msg?", None, &|_| vec![1]),
    ]);
    let reading = check_choice(&bytes, &["/step:action"], &["/step:state"]);
    assert_eq!(reading.row.n_messages, 20);
    assert_eq!(
        reading.row.episode_rule.as_deref(),
        Some("field:/step:episode")
    );
    // Only what is not asked for is found out.
    let mixed = read(&bytes, "--action /cmd:data");
    assert_eq!(mixed.row.state_selector.as_deref(), Some("/step:state"));
    assert_eq!(mixed.sizes(), [20]);
}

/// Every line of flags that an error prints, which must read the recording.
#[track_caller]
fn check_flags(bytes: &[u8], flags: &str, words: &str, n_readings: usize) {
    let refused = read(bytes, flags);
    assert_eq!(refused.row.status, RecordingStatus::Failed);
    assert!(refused.error().contains(words), "{}", refused.error());
    let inspected = inspection(bytes, flags);
    assert_eq!(inspected.undecided.as_deref(), Some(refused.error()));
    let lines: Vec<&str> = refused
        .error()
        .lines()
        .map(str::trim)
        .filter(|l| l.starts_with("--"))
        .collect();
    assert_eq!(lines.len(), n_readings, "{}", refused.error());
    assert_eq!(inspected.flags.as_deref(), lines.first().copied());
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.mcap");
    std::fs::write(&path, bytes).unwrap();
    for (i, line) in lines.iter().enumerate() {
        let settled = read(bytes, line);
        assert_eq!(
            settled.row.status,
            RecordingStatus::Ok,
            "{line}: {:?}",
            settled.row
        );
        assert_eq!(settled.sizes().iter().sum::<usize>(), 20, "{line}");
        // As they are typed into a shell.
        let command = format!(
            "'{}' extract '{}' -o '{}' -q {line}",
            env!("CARGO_BIN_EXE_coact"),
            path.display(),
            dir.path().join(i.to_string()).display()
        );
        let output = Command::new("sh").args(["-c", &command]).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{command}: {output:?}");
    }
}

#[test]
fn an_ambiguity_prints_flags_that_settle_it() {
    let joints = (
        "/joint_states",
        "cdr",
        Some(JOINT_STATE),
        &joints_at as &dyn Fn(u64) -> Vec<u8>,
    );
    let command = |i: u64| multi_array(&[i as f64]);
    let goals = |i: u64| trajectory(&["a", "b"], &[i as f64, 0.0]);
    let array = (
        "/arm/it's commands",
        "cdr",
        Some(MULTI_ARRAY),
        &command as _,
    );
    let goal = ("/goal", "cdr", Some(TRAJECTORY), &goals as _);
    check_flags(&topics(&[joints, array, goal]), "", "several readings", 2);

    // Two arms, each leader and follower.
    let arm = |topic| (topic, "cdr", Some(JOINT_STATE), &joints_at as _);
    let arms = topics(&[
        arm("/left/leader"),
        arm("/left/follower"),
        arm("/right/leader"),
        arm("/right/follower"),
    ]);
    check_flags(&arms, "", "several readings", 4);
    // Asked for one, the other is found.
    let half = read(
        &arms,
        "--action /left/leader:position --action /right/leader:position",
    );
    assert!(half.error().contains("several readings"));
    assert_eq!(
        half.error()
            .matches("--action /right/leader:position")
            .count(),
        2
    );

    // Two that name no command: which is the action?
    let two = topics(&[arm("/one"), arm("/two")]);
    check_flags(&two, "", "states but no actions", 2);
    // One joint state alone is the state, whatever its name.
    let one = topics(&[arm("/leader")]);
    let alone = read(&one, "");
    assert!(
        alone.error().contains("states but no actions"),
        "{}",
        alone.error()
    );

    // No type that is known.
    let fields = |i: u64| {
        json!({"mo:tor": {"set.point": [i, i + 1]}, "sensors": [i, 2 * i], "note": "x"})
            .to_string()
            .into_bytes()
    };
    let unknown = topics(&[("/robot state", "json", None, &fields)]);
    check_flags(&unknown, "", "neither actions nor states", 2);
}

#[test]
fn nothing_found_lists_what_is_there() {
    let bytes = topics(&[
        ("/camera", "capnproto", None, &|_| vec![0]),
        ("/text", "json", None, &|_| br#"{"line":"hello"}"#.to_vec()),
        (
            "/odd",
            "cdr",
            Some(("my/Odd", "ros2idl", b"struct Odd {};")),
            &|_| vec![0, 1, 0, 0],
        ),
    ]);
    let reading = read(&bytes, "");
    assert_eq!(reading.row.status, RecordingStatus::Failed);
    for words in [
        "/camera (capnproto, 20 messages)",
        "/text (json, 20 messages)",
        "/odd (cdr, 20 messages)",
    ] {
        assert!(reading.error().contains(words), "{}", reading.error());
    }
    let inspected = inspection(&bytes, "");
    let problem = |topic: &str| {
        let found = inspected.topics.iter().find(|t| t.topic == topic).unwrap();
        found.problem.clone().unwrap_or_default()
    };
    assert!(problem("/camera").contains("\"capnproto\" is not supported"));
    assert!(problem("/odd").contains("my/Odd") && problem("/odd").contains("ros2idl"));
    assert_eq!(problem("/text"), "");

    // Asked for, they are refused by name.
    let read = |flags: &str| read(&bytes, flags).error().to_owned();
    let error = read("--action /camera:x --state /text:line");
    assert!(
        error.contains("\"/camera\"") && error.contains("\"capnproto\""),
        "{error}"
    );
    let error = read("--action /odd:x --state /text:line");
    assert!(
        error.contains("\"/odd\"") && error.contains("ros2idl"),
        "{error}"
    );
    let error = read("--action /none:x --state /text:line");
    assert!(error.contains("no message on topic \"/none\""), "{error}");
    assert!(
        error.contains("/camera (capnproto, 20 messages)"),
        "{error}"
    );
}

/// A file of a split recording: other topics first, so that ids differ from file to file.
fn part(range: std::ops::Range<u64>, n_others: u64) -> Vec<u8> {
    let mut b = RecordingBuilder::new();
    for other in 0..n_others {
        b.json(&format!("/other{other}"), range.start * 10, &json!({}));
    }
    let schema = |n: u64| -> Schema<'static> {
        // In another order from file to file, too.
        if n == 0 { JOINT_STATE } else { MULTI_ARRAY }
    };
    let channels = [n_others % 2, 1 - n_others % 2].map(|n| {
        let topic = ["/joint_states", "/cmd"][n as usize];
        (n, b.channel(topic, "cdr", Some(schema(n))))
    });
    for i in range {
        for (n, channel) in channels {
            let message = if n == 0 {
                let (a, b) = (i as f64, i as f64 + 100.0);
                // Each file begins with the names in another order.
                match n_others % 2 {
                    0 => joint_state(0, &["a", "b"], &[a, b]),
                    _ => joint_state(0, &["b", "a"], &[b, a]),
                }
            } else {
                multi_array(&[i as f64])
            };
            b.send(channel, i * 10 + n, 0, &message);
        }
    }
    b.finish()
}

const SPLIT: &str = "--action /cmd:data --state /joint_states:position";

#[test]
fn files_of_one_recording_have_ids_and_orders_of_their_own() {
    let files = [part(0..20, 0), part(20..40, 3), part(40..60, 2)];
    let files: Vec<Option<&[u8]>> = files.iter().map(|f| Some(f.as_slice())).collect();
    let asked = read_split(&files, SPLIT);
    assert_eq!(asked.sizes(), [60]);
    assert_eq!(columns(&asked), [rising(60, 0.0), rising(60, 100.0)]);
    let auto = read_split(&files, "");
    assert_eq!(auto.episodes, asked.episodes);
    assert_eq!(auto.row.n_messages, 120);
    assert_eq!(
        inspection_of_split(&files, "").flags.as_deref(),
        Some(SPLIT)
    );
}

#[test]
fn a_file_that_is_missing_is_said_and_the_others_are_read() {
    let (first, middle, last) = (part(0..20, 0), part(20..40, 3), part(40..60, 2));
    for flags in ["", SPLIT] {
        let reading = read_split(&[Some(&first), None, Some(&last)], flags);
        assert_eq!(
            reading.row.status,
            RecordingStatus::Recovered,
            "{:?}",
            reading.row
        );
        assert!(reading.error().contains("r_1.mcap"), "{}", reading.error());
        assert_eq!(reading.sizes(), [20], "{flags}");
        assert!(reading.reason(0).contains("steps may be lost"));
        assert_eq!(reading.row.n_messages, 80);

        let reading = read_split(&[None, Some(&middle), Some(&last)], flags);
        assert_eq!(
            reading.row.status,
            RecordingStatus::Recovered,
            "{:?}",
            reading.row
        );
        assert!(reading.error().contains("r_0.mcap"), "{}", reading.error());
        assert_eq!(reading.sizes(), [40], "{flags}");
        assert!(
            reading.reason(0).contains("first steps may be lost"),
            "{flags}"
        );

        let junk: &[u8] = b"SQLite format 3\0....";
        let reading = read_split(&[Some(&first), Some(junk), Some(&last)], flags);
        assert!(reading.error().contains("SQLite"), "{}", reading.error());
        assert_eq!(reading.sizes(), [20], "{flags}");

        let reading = read_split(&[None, None], flags);
        assert_eq!(reading.row.status, RecordingStatus::Failed);
    }
    let inspected = inspection_of_split(&[Some(&first), None, Some(&last)], "");
    assert_eq!((inspected.error, inspected.n_damages), (None, 1));
    assert!(inspected.damage[0].contains("r_1.mcap"));
}

#[test]
fn a_damaged_first_file_gives_what_is_whole() {
    // Its first chunk, with the definitions, is lost: the summary still has them.
    let mut b = RecordingBuilder::with_layout(Layout {
        compression: None,
        chunk_size: 900,
        ..Layout::default()
    });
    for i in 0..40u64 {
        let states = b.channel("/joint_states", "cdr", Some(JOINT_STATE));
        let actions = b.channel("/cmd", "cdr", Some(MULTI_ARRAY));
        b.send(states, i * 10, 0, &joints_at(i));
        b.send(actions, i * 10 + 1, 0, &multi_array(&[i as f64]));
    }
    let mut first = b.finish();
    let at = first.windows(6).position(|w| w == b"joints").unwrap();
    first[at] ^= 1;
    let second = part(40..60, 1);
    for flags in ["", SPLIT] {
        let alone = read(&first, flags);
        assert_eq!(
            alone.row.status,
            RecordingStatus::Recovered,
            "{flags}: {:?}",
            alone.row
        );
        assert!(alone.error().contains("CRC"), "{}", alone.error());
        assert!(
            alone.reason(0).contains("first steps may be lost"),
            "{flags}"
        );
        let n = alone.sizes()[0];
        assert!(n > 20 && n < 40, "{flags}: {n}");
        let split = read_split(&[Some(&first), Some(&second)], flags);
        assert_eq!(split.sizes(), [n + 20], "{flags}: {:?}", split.row);
        assert_eq!(split.actions(0), split.states(0), "{flags}");
        let by_hundred: Vec<f64> = split.states(0).iter().map(|v| v + 100.0).collect();
        assert_eq!(split.states(1), by_hundred, "{flags}");
    }
    // Zipped, nothing behind the loss can be paired.
    let zipped = read(&first, &format!("{SPLIT} --align index"));
    assert!(zipped.sizes().iter().all(|&n| n == 0), "{:?}", zipped.row);
    let inspected = inspection(&first, "");
    assert_eq!(inspected.flags.as_deref(), Some(SPLIT));
}

#[test]
fn a_topic_may_have_several_channels() {
    // By turns in JSON without a schema, in JSON with one, in CDR; names permuted in each.
    let mut b = RecordingBuilder::new();
    for i in 0..30u64 {
        let (a, z) = (i as f64, i as f64 + 100.0);
        let channel = match i % 3 {
            0 => b.channel("/obs", "json", None),
            1 => b.channel("/obs", "json", Some(("Joints", "jsonschema", b"{}"))),
            _ => b.channel("/obs", "cdr", Some(JOINT_STATE)),
        };
        let data = match i % 3 {
            0 => json!({"name": ["a", "z"], "position": [a, z]})
                .to_string()
                .into_bytes(),
            1 => json!({"position": [z, a], "name": ["z", "a"]})
                .to_string()
                .into_bytes(),
            _ => joint_state(0, &["z", "a"], &[z, a]),
        };
        b.send(channel, i * 10, 0, &data);
        b.json("/act", i * 10 + 1, &json!({"v": [i]}));
    }
    let bytes = b.finish();
    let reading = read(&bytes, "--action /act:v --state /obs:position");
    assert_eq!(
        columns(&reading),
        [rising(30, 0.0), rising(30, 100.0)],
        "{:?}",
        reading.row
    );
    assert_eq!(reading.row.encoding.as_deref(), Some("json, cdr"));
    let picked = read(
        &bytes,
        "--action /act:v --state /obs:position[z] --state /obs:position[a]",
    );
    assert_eq!(columns(&picked), [rising(30, 100.0), rising(30, 0.0)]);
    let topics = inspection(&bytes, "").topics;
    let topic = topics.iter().find(|t| t.topic == "/obs").unwrap();
    assert_eq!(topic.encodings, ["json", "cdr"]);
    assert_eq!(topic.n_messages, 30);
}

#[test]
fn a_channel_that_cannot_be_read_says_nothing_of_another() {
    // A second channel of the steps, of which no message can be read: whose steps they were is not known.
    let mut b = RecordingBuilder::new();
    let second = b.channel("/step", "json", Some(("Step", "jsonschema", b"{}")));
    for step in 0..20 {
        b.step(&step_message(0, step, step == 19));
        if step == 12 {
            b.send(second, 0, 0, b"garbage");
        }
    }
    b.episode(1, 12);
    let reading = read(&b.finish(), "");
    // Step numbers show that nothing is lacking.
    assert_eq!(reading.sizes(), [20, 12], "{:?}", reading.row);
    assert_eq!((reading.reason(0), reading.reason(1)), ("", ""));
    assert_eq!(reading.refused("not JSON"), 1);
}

#[test]
fn a_stray_channel_of_a_topic_costs_its_own_messages() {
    const TEXT: Schema<'static> = ("std_msgs/msg/String", "ros2msg", b"string data");
    for (encoding, schema, data, words) in [
        (
            "cdr",
            Some(TEXT),
            &b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00"[..],
            "std_msgs/String",
        ),
        ("capnproto", None, &b"x"[..], "capnproto"),
    ] {
        for stray in ["/act", "/obs"] {
            let mut b = RecordingBuilder::new();
            for i in 0..30u64 {
                let states = b.channel("/obs", "cdr", Some(JOINT_STATE));
                b.send(states, i * 10, 0, &joints_at(i));
                let actions = b.channel("/act", "cdr", Some(MULTI_ARRAY));
                b.send(actions, i * 10 + 1, 0, &multi_array(&[i as f64]));
                if i == 12 {
                    let channel = b.channel(stray, encoding, schema);
                    b.send(channel, i * 10 + 2, 0, data);
                }
            }
            let reading = read(&b.finish(), "--action /act:data --state /obs:position");
            assert_eq!(reading.refused(words), 1, "{stray}: {:?}", reading.row);
            // A bad action ends the episode, a bad state is left out.
            let n = if stray == "/act" { 13 } else { 30 };
            assert_eq!(reading.sizes(), [n], "{stray}: {:?}", reading.row);
        }
    }
}
