//! Writes recordings for benchmarks: one of 128 state columns, half of them small integers and half floats of 17 digits,
//! one action, episodes of 2,000 steps, chunks of 1 MiB in zstd; or many, each of 200 steps and 4 state columns;
//! or one episode of 33,600 state columns, as many as a grey image has.
//!
//! ```sh
//! cargo run --release --example generate_recording -- json 1000 out.mcap    # about 1,000 MB of messages
//! cargo run --release --example generate_recording -- cdr 1000 out.mcap     # read with the flags it prints
//! cargo run --release --example generate_recording -- many 5000 folder      # 5,000 recordings in JSON
//! cargo run --release --example generate_recording -- wide 500 out.mcap     # one episode of 500 steps
//! ```
#![expect(clippy::print_stdout, reason = "it tells how to read the file")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};

/// Columns of the state: in one large recording, in many small ones, in one that is wide.
const N_STATE_DIMS: usize = 128;
const N_SMALL_STATE_DIMS: usize = 4;
const N_WIDE_STATE_DIMS: usize = 33_600;

/// Steps of an episode, in one large recording and in many small ones.
const EPISODE_STEPS: u64 = 2_000;
const SMALL_EPISODE_STEPS: u64 = 200;

/// Nanoseconds between two steps, and between two episodes.
const STEP_NANOS: u64 = 20_000_000;
const PAUSE_NANOS: u64 = 10_000_000_000;

/// Chunk size, bytes.
const CHUNK: u64 = 1 << 20;

const MULTI_ARRAY: &str = "MultiArrayLayout layout\nfloat64[] data\n\
    ================================================================================\n\
    MSG: std_msgs/MultiArrayLayout\nMultiArrayDimension[] dim\nuint32 data_offset\n\
    ================================================================================\n\
    MSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n";

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [kind, number, path] = arguments.as_slice() else {
        bail!(
            "usage: generate_recording json|cdr MEGABYTES FILE.mcap, or: many NUMBER FOLDER, or: wide STEPS FILE.mcap"
        );
    };
    let number = number
        .parse::<u64>()
        .context("MEGABYTES, NUMBER or STEPS")?;
    match kind.as_str() {
        "json" => {
            let agent = Agent::new(1, N_STATE_DIMS);
            let of_bytes = |_, bytes| bytes < number * 1_000_000;
            let (steps, bytes) = json(create(path)?, agent, EPISODE_STEPS, of_bytes)?;
            println!("{steps} steps, {bytes} bytes of messages; coact extract FILE -o out");
            Ok(())
        }
        "cdr" => cdr(create(path)?, number * 1_000_000),
        "wide" => {
            let agent = Agent::new(1, N_WIDE_STATE_DIMS);
            json(create(path)?, agent, number, |step, _| step == 0)?;
            println!("{number} steps; coact extract FILE -o out");
            Ok(())
        }
        "many" => {
            fs::create_dir_all(path)?;
            for nth in 0..number {
                let file = Path::new(path).join(format!("{nth:06}.mcap"));
                let agent = Agent::new(nth, N_SMALL_STATE_DIMS);
                json(create(file)?, agent, SMALL_EPISODE_STEPS, |step, _| {
                    step == 0
                })?;
            }
            println!("{number} recordings; coact extract FOLDER -o out");
            Ok(())
        }
        other => bail!("{other:?} is neither json, cdr, many nor wide"),
    }
}

fn create(path: impl AsRef<Path>) -> Result<Writer<BufWriter<File>>> {
    let file = BufWriter::new(File::create(path).context("cannot be created")?);
    Ok(WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .chunk_size(Some(CHUNK))
        .create(file)?)
}

/// `SplitMix64`: the same file on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In 0..1, of 53 random bits.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// One step: the action changes now and then, integers drift, floats are noise.
struct Agent {
    random: Random,
    action: f64,
    integers: Vec<u8>,
    n_floats: usize,
}

impl Agent {
    fn new(seed: u64, n_state_dims: usize) -> Self {
        Self {
            random: Random(seed),
            action: 0.0,
            integers: vec![128; n_state_dims / 2],
            n_floats: n_state_dims - n_state_dims / 2,
        }
    }

    fn step(&mut self, state: &mut Vec<f64>) -> f64 {
        if self.random.next().is_multiple_of(12) {
            self.action = (self.random.next() % 6) as f64;
        }
        state.clear();
        for integer in &mut self.integers {
            let draw = self.random.next() % 8;
            *integer = match draw {
                0 => integer.wrapping_add(1),
                1 => integer.wrapping_sub(1),
                _ => *integer,
            };
            state.push(f64::from(*integer));
        }
        for _ in 0..self.n_floats {
            state.push(self.random.unit());
        }
        self.action
    }
}

fn time_of(step: u64) -> u64 {
    1_700_000_000_000_000_000 + step * STEP_NANOS + (step / EPISODE_STEPS) * PAUSE_NANOS
}

fn header(channel_id: u16, step: u64, log_time: u64) -> MessageHeader {
    MessageHeader {
        channel_id,
        sequence: u32::try_from(step % (1 << 32)).unwrap_or(0),
        log_time,
        publish_time: log_time,
    }
}

/// Whole episodes, as long as there `is_more`, by the steps and bytes so far; how many those were.
fn json(
    mut writer: Writer<BufWriter<File>>,
    mut agent: Agent,
    episode_steps: u64,
    is_more: impl Fn(u64, u64) -> bool,
) -> Result<(u64, u64)> {
    let channel = writer.add_channel(0, "/step", "json", &BTreeMap::new())?;
    let (mut state, mut text, mut written, mut step) = (Vec::new(), String::new(), 0, 0);
    while is_more(step, written) || step % episode_steps != 0 {
        let action = agent.step(&mut state);
        let (episode, number) = (step / episode_steps, step % episode_steps);
        text.clear();
        write!(
            text,
            "{{\"episode\":{episode},\"step\":{number},\"action\":[{action}],\"state\":["
        )?;
        for (i, value) in state.iter().enumerate() {
            let separator = if i == 0 { "" } else { "," };
            write!(text, "{separator}{value}")?;
        }
        let ended = number + 1 == episode_steps;
        write!(text, "],\"reward\":1,\"terminated\":{ended}}}")?;
        writer.write_to_known_channel(&header(channel, step, time_of(step)), text.as_bytes())?;
        written += text.len() as u64;
        step += 1;
    }
    writer.finish()?;
    Ok((step, written))
}

/// A `std_msgs/Float64MultiArray` with an empty layout.
fn multi_array(values: &[f64], message: &mut Vec<u8>) -> Result<()> {
    message.clear();
    message.extend([0, 1, 0, 0]);
    // No dimensions, no offset; then the count, and padding to 8 behind the header.
    message.extend([0; 8]);
    message.extend(u32::try_from(values.len())?.to_le_bytes());
    message.extend([0; 4]);
    for value in values {
        message.extend(value.to_le_bytes());
    }
    Ok(())
}

fn cdr(mut writer: Writer<BufWriter<File>>, n_bytes: u64) -> Result<()> {
    let schema = writer.add_schema(
        "std_msgs/msg/Float64MultiArray",
        "ros2msg",
        MULTI_ARRAY.as_bytes(),
    )?;
    let states = writer.add_channel(schema, "/state", "cdr", &BTreeMap::new())?;
    let commands = writer.add_channel(schema, "/command", "cdr", &BTreeMap::new())?;
    let (mut agent, mut state, mut message, mut written, mut step) =
        (Agent::new(1, N_STATE_DIMS), Vec::new(), Vec::new(), 0, 0);
    while written < n_bytes || step % EPISODE_STEPS != 0 {
        let action = agent.step(&mut state);
        multi_array(&state, &mut message)?;
        written += message.len() as u64;
        writer.write_to_known_channel(&header(states, step, time_of(step)), &message)?;
        multi_array(&[action], &mut message)?;
        written += message.len() as u64;
        // The action is chosen from the state, and published a little after it.
        let time = time_of(step) + 1_000_000;
        writer.write_to_known_channel(&header(commands, step, time), &message)?;
        step += 1;
    }
    writer.finish()?;
    println!(
        "{step} steps, {written} bytes of messages; coact extract FILE -o out --action /command:data --state /state:data --episodes gap:5"
    );
    Ok(())
}
