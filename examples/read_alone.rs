//! Reads a recording with the official reader and does nothing else: what `coact extract` is measured against.
//!
//! JSON messages are parsed by typed `serde_json` (feature `float_roundtrip`); from CDR messages the packed doubles
//! behind the header of a `std_msgs/Float64MultiArray` are copied.
//!
//! ```sh
//! cargo run --release --example read_alone -- FILE.mcap
//! ```
#![expect(clippy::print_stdout, reason = "it tells what it read")]

use std::fs;
use std::hint::black_box;

use anyhow::{Context, Result, bail};
use serde::Deserialize;

/// Bytes in front of the doubles: encapsulation, empty layout, count, padding.
const HEAD: usize = 20;

#[derive(Deserialize)]
#[expect(dead_code, reason = "parsing is what is measured")]
struct Step {
    episode: i64,
    #[serde(rename = "step")]
    number: i64,
    action: Vec<f64>,
    state: Vec<f64>,
    reward: Option<f64>,
    #[serde(default)]
    terminated: bool,
}

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .context("usage: read_alone FILE.mcap")?;
    let bytes = fs::read(path)?;
    let (mut n_messages, mut n_values) = (0u64, 0u64);
    let mut values: Vec<f64> = Vec::new();
    for message in mcap::MessageStream::new(&bytes)? {
        let message = message?;
        match message.channel.message_encoding.as_str() {
            "json" => {
                let step: Step = serde_json::from_slice(&message.data)?;
                n_values += step.state.len() as u64;
                black_box(&step);
            }
            "cdr" => {
                values.clear();
                let packed = message.data.get(HEAD..).unwrap_or_default();
                values.extend(
                    packed
                        .as_chunks::<8>()
                        .0
                        .iter()
                        .map(|c| f64::from_le_bytes(*c)),
                );
                n_values += values.len() as u64;
                black_box(&values);
            }
            other => bail!("encoding {other:?}"),
        }
        n_messages += 1;
    }
    println!("{n_messages} messages, {n_values} values");
    Ok(())
}
