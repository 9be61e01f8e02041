//! SIGINT and SIGTERM: a run stops within two seconds and leaves nothing half done; one that writes to an object store
//! has longer, and stops at once when it is asked again.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::Duration;

use crate::pipeline::{Interrupt, is_in_store, remove_temporaries};

/// How long a run may take to stop by itself, once asked.
const PATIENCE: Duration = Duration::from_millis(1_500);

/// The same where what is in hand goes to an object store.
const PATIENCE_WITH_STORE: Duration = Duration::from_secs(20);

/// The same for a watch, which ends with what is complete committed, and parts merged.
const PATIENCE_OF_WATCH: Duration = Duration::from_mins(1);

/// Exit code of a process that a signal ended: 128 and the signal's number.
const SIGNALLED: i32 = 128;

/// What has been signalled.
pub struct Signals {
    received: Arc<AtomicI32>,
}

impl Signals {
    /// Raises `interrupt` on the first signal. A run that does not stop in time is ended;
    /// its temporary files in the folders of tables and of events are removed before.
    pub fn watch(
        interrupt: &Arc<Interrupt>,
        tables: Option<PathBuf>,
        events: Option<PathBuf>,
    ) -> Self {
        let is_in_store = tables.as_ref().is_some_and(|output| is_in_store(output));
        let patience = if is_in_store {
            PATIENCE_WITH_STORE
        } else {
            PATIENCE
        };
        Self::with_patience(interrupt, tables, events, patience)
    }

    /// The same for a command that ends well by being asked to stop. The second signal ends it at once.
    pub fn of_watch(interrupt: &Arc<Interrupt>, output: Option<PathBuf>) -> Self {
        Self::with_patience(interrupt, output, None, PATIENCE_OF_WATCH)
    }

    fn with_patience(
        interrupt: &Arc<Interrupt>,
        tables: Option<PathBuf>,
        events: Option<PathBuf>,
        patience: Duration,
    ) -> Self {
        let received = Arc::new(AtomicI32::new(0));
        #[cfg(unix)]
        unix::watch(
            Arc::clone(interrupt),
            (tables, events),
            Arc::clone(&received),
            patience,
        );
        #[cfg(not(unix))]
        let _ = (interrupt, tables, events, patience);
        Self { received }
    }

    /// 130 for SIGINT, 143 for SIGTERM.
    pub fn exit_code(&self) -> u8 {
        code(self.received.load(Ordering::Relaxed))
    }
}

fn code(signal: i32) -> u8 {
    u8::try_from(SIGNALLED + signal).unwrap_or(u8::MAX)
}

#[cfg(unix)]
mod unix {
    use std::sync::atomic::AtomicBool;
    use std::time::Instant;

    use super::{
        Arc, AtomicI32, Duration, Interrupt, Ordering, PATIENCE, PathBuf, code, remove_temporaries,
    };

    use signal_hook::consts::{SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals as SignalStream;

    /// Between two looks at whether a second signal came.
    const PAUSE: Duration = Duration::from_millis(50);

    /// Of tables and of events.
    type Folders = (Option<PathBuf>, Option<PathBuf>);

    pub(super) fn watch(
        interrupt: Arc<Interrupt>,
        folders: Folders,
        received: Arc<AtomicI32>,
        patience: Duration,
    ) {
        // Without a handler a signal ends the process at once; the next run then clears up.
        limit_is_an_error();
        let Ok(mut signals) = SignalStream::new([SIGINT, SIGTERM]) else {
            return;
        };
        std::thread::spawn(move || {
            let Some(signal) = signals.forever().next() else {
                return;
            };
            received.store(signal, Ordering::Relaxed);
            interrupt.raise();
            let started = Instant::now();
            while started.elapsed() < patience {
                std::thread::sleep(PAUSE);
                if patience > PATIENCE && signals.pending().next().is_some() {
                    break;
                }
            }
            end(signal, &folders);
        });
    }

    /// Without a handler SIGXFSZ ends the process where a file reaches the limit of its size; with one the write fails,
    /// and the run says which file it was and clears up.
    fn limit_is_an_error() {
        let nobody_asks = Arc::new(AtomicBool::new(false));
        let _without_handler = signal_hook::flag::register(SIGXFSZ, nobody_asks);
    }

    #[expect(clippy::exit, reason = "the run did not stop in time")]
    fn end(signal: i32, (tables, events): &Folders) {
        remove_temporaries(tables.as_deref(), events.as_deref());
        std::process::exit(i32::from(code(signal)));
    }
}
