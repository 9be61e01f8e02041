//! How the columns of an episode are shared out among threads.

use rayon::prelude::*;

/// Values (step × column) below which an episode is not shared out: waking another thread takes longer.
const PARALLEL_VALUES: usize = 1 << 17;

/// Columns that one task takes: enough for its tables to pay, few enough to share out.
const BLOCK_COLUMNS: std::ops::RangeInclusive<usize> = 8..=64;

/// Values that one task takes, within [`BLOCK_COLUMNS`].
const BLOCK_VALUES: usize = 1 << 19;

/// Is an episode large enough for several threads?
pub(super) fn are_worth_it(n_steps: usize, n_columns: usize) -> bool {
    n_steps.saturating_mul(n_columns) >= PARALLEL_VALUES
}

/// `f` of each block of columns, in order.
///
/// Where blocks begin and end depends on the episode alone: sums of f64 do not depend on the number of threads.
pub(super) fn map_blocks<C: Sync, R: Send>(
    columns: &[C],
    n_steps: usize,
    f: impl Fn(&[C]) -> R + Sync + Send,
) -> Vec<R> {
    let block = (BLOCK_VALUES / n_steps.max(1)).clamp(*BLOCK_COLUMNS.start(), *BLOCK_COLUMNS.end());
    if are_worth_it(n_steps, columns.len()) {
        columns.par_chunks(block).map(f).collect()
    } else {
        columns.chunks(block).map(f).collect()
    }
}

/// `f` of each column on its own, in order.
pub(super) fn map_each<C: Sync, R: Send>(
    columns: &[C],
    n_steps: usize,
    f: impl Fn(&C) -> R + Sync + Send,
) -> Vec<R> {
    if are_worth_it(n_steps, columns.len()) {
        columns.par_iter().map(f).collect()
    } else {
        columns.iter().map(f).collect()
    }
}

/// All columns added to accumulators, and these to one another: how many there are depends on the threads, so only for
/// sums that do not depend on their order.
pub(super) fn fold<C: Sync, A: Send>(
    columns: &[C],
    n_steps: usize,
    new: impl Fn() -> A + Sync + Send,
    add: impl Fn(&mut A, &C) + Sync + Send,
    merge: impl Fn(A, A) -> A + Sync + Send,
) -> A {
    let added = |mut to: A, column: &C| {
        add(&mut to, column);
        to
    };
    if are_worth_it(n_steps, columns.len()) {
        let parts = columns.par_iter().fold(&new, added);
        parts.reduce_with(merge).unwrap_or_else(new)
    } else {
        columns.iter().fold(new(), added)
    }
}

/// Both results, computed at the same time if that is worth it.
pub(super) fn join<A: Send, B: Send>(
    parallel: bool,
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if parallel {
        rayon::join(a, b)
    } else {
        (a(), b())
    }
}
