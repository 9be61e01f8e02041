//! Composite actions as events, and the changes they follow from as series, in an MCAP file beside each recording.
//!
//! ```text
//! Episode, Outcome ──> timeline ──> messages ──> sidecar ──> DIR/NAME.events.mcap
//!                      (by step)    (protobuf)   (MCAP)
//! ```
//!
//! | topic | schema | one message |
//! |---|---|---|
//! | `/coact/events` | `foxglove.Event` | a composite action: start, end (of its last step), metadata |
//! | `/coact/state` | `coact.StateChange` | a step: measure, change and mask of the state |
//! | `/coact/joints/NAME` | `coact.ActionChange` | a step of a joint: action, measure, change, mask, correlation, segment |
//!
//! `foxglove.Event` is the published schema of that name (<https://docs.foxglove.dev/docs/sdk/schemas/event>):
//! `start_time`, `end_time`, both inclusive, and `metadata` of keys and values.
//!
//! The encoding is protobuf, whose schema, a `FileDescriptorSet`, stands in the file. Foxglove and Lichtblick read JSON
//! as well, but Rerun decodes no JSON; and a step takes a third of the bytes. The series are flat, a topic a joint, as
//! every viewer plots a field of a message by its path (`/coact/joints/elbow.change`), but not all of them elements of
//! lists. Times are those of the steps, by the clock that the tables have, so that a viewer shows events and series
//! beside the recording when it opens both files.
//!
//! A file counts once it has its name, which it gets when it is complete and flushed to disk. It begins with a metadata
//! record of the recording's identity and the parameters: a run that goes on knows by this whether a file is that
//! recording's, and makes it again where it is not. The same recording and parameters give the same bytes.

mod error;
mod messages;
mod names;
mod sidecar;
mod timeline;
mod writer;

pub use error::EventsError;
pub use messages::{ActionChange, Event, KeyValuePair, StateChange, Timestamp};
pub use names::is_events_file;
pub use writer::{EventsOptions, EventsWriter, Item, remove_temporaries};
