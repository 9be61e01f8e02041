//! Calls to the file system that fail because a test asks for it.

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

/// Makes the N-th call to the file system fail, for tests of what then happens.
#[derive(Debug, Default)]
pub struct Faults {
    calls: AtomicU64,
    fail_at: Option<u64>,
    for_good: bool,
    pub(super) no_locks: bool,
}

impl Faults {
    /// Fails nothing, and counts the calls.
    pub fn none() -> Self {
        Self::default()
    }

    /// Fails call number `n` (from 0); `for_good` fails all after it too, as a full disk does.
    pub fn at(n: u64, for_good: bool) -> Self {
        Self {
            calls: AtomicU64::new(0),
            fail_at: Some(n),
            for_good,
            no_locks: false,
        }
    }

    /// Refuses locks, as some network drives do, and nothing else.
    pub fn no_locks() -> Self {
        Self {
            no_locks: true,
            ..Self::default()
        }
    }

    /// Calls so far.
    pub fn calls(&self) -> u64 {
        self.calls.load(Ordering::Relaxed)
    }

    pub(super) fn check(&self) -> io::Result<()> {
        let call = self.calls.fetch_add(1, Ordering::Relaxed);
        match self.fail_at {
            Some(n) if call == n || (self.for_good && call > n) => {
                Err(io::Error::other("a fault that a test asked for"))
            }
            _ => Ok(()),
        }
    }
}
