//! Schemas and channels from the summary section, for a file that lost the chunk which defined them. The only use that
//! is made of a summary, and only where the data has no such definition.

use std::path::Path;

use super::error::RecordingError;
use super::limits::Limits;
use super::open;
use super::records::{Next, op};
use super::wire::{Channel, Schema};

/// The definitions behind the data section; none if the file ends before.
pub(crate) fn definitions(
    path: &Path,
    limits: &Limits,
) -> Result<(Vec<Schema>, Vec<Channel>), RecordingError> {
    let mut stream = open::open(path, limits)?.stream;
    let (mut schemas, mut channels) = (Vec::new(), Vec::new());
    let mut in_summary = false;
    let mut body = Vec::new();
    let wanted = |opcode| matches!(opcode, op::SCHEMA | op::CHANNEL);
    loop {
        match stream.next(wanted, &mut body) {
            Next::Record {
                opcode: op::DATA_END,
                ..
            } => in_summary = true,
            Next::Record {
                opcode: op::SCHEMA, ..
            } if in_summary => schemas.extend(Schema::parse(&body)),
            Next::Record {
                opcode: op::CHANNEL,
                ..
            } if in_summary => channels.extend(Channel::parse(&body)),
            Next::Record { .. } | Next::TooLarge { .. } => {}
            Next::Cut { .. }
            | Next::ClosingMagic { .. }
            | Next::End { .. }
            | Next::NoRecord { .. } => {
                return Ok((schemas, channels));
            }
        }
    }
}
