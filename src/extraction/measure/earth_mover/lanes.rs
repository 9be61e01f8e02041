//! Many windows side by side: what the compiler turns into vectors. See `earth_mover` for the method.

use super::super::look_up;

/// Windows that a kernel takes at a time, at least: sums hold whole blocks of them.
pub(super) const LANES: usize = 32;

/// Widest window that has a kernel of its own.
const MAX_UNROLLED: usize = 16;

/// Values that a kernel reads, and makes no use of, behind those of its last window.
pub(super) const PADDING: usize = 2 * MAX_UNROLLED;

/// Windows that the kernel of narrow windows takes at a time. Enough for sorted values to be in the cache before they
/// are read at another offset (a load waits for stores under way that it overlaps), few enough for short episodes.
const MANY: usize = 128;

/// Lanes of its sorted values: those of the windows, and W more.
const SPAN: usize = MANY + MAX_UNROLLED;

/// What a count is in a vector of the kernel: twice as many fit where 16 bits suffice.
pub(super) trait Lane: Copy + Ord + Default + Send + Sync {
    const MAX: Self;

    fn distance(self, other: Self) -> Self;

    /// Distances that are too large for the lane become its maximum: the windows that start one step apart are nearer,
    /// so none of them is ever the least.
    fn plus(self, other: Self) -> Self;

    fn to_u32(self) -> u32;

    fn look_up(table: &[Self], column: &[u16], out: &mut [Self]);

    fn add_least(
        x: &[Self],
        width: usize,
        limits: Option<&[u32]>,
        rows: &mut Rows<Self>,
        sums: &mut [u32],
    );
}

impl Lane for u16 {
    const MAX: Self = Self::MAX;

    #[inline]
    fn distance(self, other: Self) -> Self {
        self.abs_diff(other)
    }

    #[inline]
    fn plus(self, other: Self) -> Self {
        self.saturating_add(other)
    }

    #[inline]
    fn to_u32(self) -> u32 {
        self.into()
    }

    fn look_up(table: &[Self], column: &[u16], out: &mut [Self]) {
        look_up::look_up_16(table, column, out);
    }

    fn add_least(
        x: &[Self],
        width: usize,
        limits: Option<&[u32]>,
        rows: &mut Rows<Self>,
        sums: &mut [u32],
    ) {
        add_least_16(x, width, limits, rows, sums);
    }
}

/// Sums of W distances fit, as the caller has found.
impl Lane for u32 {
    const MAX: Self = Self::MAX;

    #[inline]
    fn distance(self, other: Self) -> Self {
        // One operation less than `abs_diff`; counts have 31 bits.
        self.wrapping_sub(other).cast_signed().unsigned_abs()
    }

    #[inline]
    fn plus(self, other: Self) -> Self {
        self + other
    }

    #[inline]
    fn to_u32(self) -> u32 {
        self
    }

    fn look_up(table: &[Self], column: &[u16], out: &mut [Self]) {
        look_up::look_up_32(table, column, out);
    }

    fn add_least(
        x: &[Self],
        width: usize,
        limits: Option<&[u32]>,
        rows: &mut Rows<Self>,
        sums: &mut [u32],
    ) {
        add_least_32(x, width, limits, rows, sums);
    }
}

macro_rules! add_least {
    ($name:ident, $lane:ty) => {
        /// `sums[s] += min over j of the distance of the windows that start at s and s + j`, j = 1..=W, or up to the
        /// limit of the window.
        #[multiversion::multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
            "x86_64+avx2",
            "aarch64+neon"
        ))]
        fn $name(
            x: &[$lane],
            width: usize,
            limits: Option<&[u32]>,
            rows: &mut Rows<$lane>,
            sums: &mut [u32],
        ) {
            let n_done = match (width, limits) {
                (2, None) => unrolled::<$lane, 2>(x, sums),
                (3, None) => unrolled::<$lane, 3>(x, sums),
                (4, None) => unrolled::<$lane, 4>(x, sums),
                (5, None) => unrolled::<$lane, 5>(x, sums),
                (6, None) => unrolled::<$lane, 6>(x, sums),
                (7, None) => unrolled::<$lane, 7>(x, sums),
                (8, None) => unrolled::<$lane, 8>(x, sums),
                (9, None) => unrolled::<$lane, 9>(x, sums),
                (10, None) => unrolled::<$lane, 10>(x, sums),
                (11, None) => unrolled::<$lane, 11>(x, sums),
                (12, None) => unrolled::<$lane, 12>(x, sums),
                (13, None) => unrolled::<$lane, 13>(x, sums),
                (14, None) => unrolled::<$lane, 14>(x, sums),
                (15, None) => unrolled::<$lane, 15>(x, sums),
                (16, None) => unrolled::<$lane, 16>(x, sums),
                _ => 0,
            };
            rolled(&x[n_done..], width, limits, rows, &mut sums[n_done..]);
        }
    };
}

add_least!(add_least_16, u16);
add_least!(add_least_32, u32);

/// The kernel of narrow windows takes large blocks; what is left, and windows with limits, that of wide ones.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn unrolled<C: Lane, const W: usize>(x: &[C], sums: &mut [u32]) -> usize {
    let mut sorted = [Row([C::default(); SPAN]); W];
    let blocks = sums.as_chunks_mut::<MANY>().0;
    for (block, sums) in blocks.iter_mut().enumerate() {
        add_block::<C, W>(&x[block * MANY..], &mut sorted, sums);
    }
    blocks.len() * MANY
}

/// Repeats a block for `$i` = 0..[`MAX_UNROLLED`], each time a constant. Loops that the compiler unrolls itself keep it
/// from making vectors of the loop around them where they are nested or long.
macro_rules! unroll {
    ($i:ident, $block:block) => {
        unroll!($i, $block, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
    };
    ($i:ident, $block:block, $($n:literal)*) => {
        $({
            const $i: usize = $n;
            $block
        })*
    };
}

#[derive(Clone, Copy)]
#[repr(align(64))]
struct Row<C>([C; SPAN]);

#[repr(align(64))]
struct Aligned<C>([C; MANY]);

/// Row i of `sorted` holds, for each lane l, the i-th of the sorted values `x[l..=l + j]`. What the window of lane l has
/// behind is what that of lane l + W has in front: each value is inserted once for both.
#[expect(
    clippy::inline_always,
    clippy::absurd_extreme_comparisons,
    clippy::needless_range_loop,
    reason = "must be compiled with the features of its caller; 0 is one of the constants; rows share an index"
)]
#[inline(always)]
fn add_block<C: Lane, const W: usize>(x: &[C], sorted: &mut [Row<C>; W], sums: &mut [u32; MANY]) {
    let mut least = Aligned([C::MAX; MANY]);
    unroll!(J, {
        if J < W {
            let values = &x[J..][..SPAN];
            for l in 0..SPAN {
                let mut carry = values[l];
                unroll!(I, {
                    if I < J {
                        let value = sorted[I].0[l];
                        sorted[I].0[l] = value.min(carry);
                        carry = value.max(carry);
                    }
                });
                sorted[J].0[l] = carry;
            }
            for l in 0..MANY {
                let mut distance = C::default();
                unroll!(I, {
                    if I <= J {
                        distance = distance.plus(sorted[I].0[l].distance(sorted[I].0[l + W]));
                    }
                });
                least.0[l] = least.0[l].min(distance);
            }
        }
    });
    for l in 0..MANY {
        sums[l] += least.0[l].to_u32();
    }
}

/// Buffers of the kernel of wide windows.
#[derive(Debug, Default)]
pub(super) struct Rows<C> {
    front: Vec<[C; LANES]>,
    behind: Vec<[C; LANES]>,
}

/// The kernel of wide windows: [`LANES`] of them side by side, in rows that stay in the cache.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn rolled<C: Lane>(
    x: &[C],
    width: usize,
    limits: Option<&[u32]>,
    rows: &mut Rows<C>,
    sums: &mut [u32],
) {
    rows.front.resize(width, [C::default(); LANES]);
    rows.behind.resize(width, [C::default(); LANES]);
    for (block, sums) in sums.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let start = block * LANES;
        let limits = limits.and_then(|limits| limits[start..].first_chunk());
        let least = rolled_block(
            &x[start..],
            width,
            limits.unwrap_or(&[u32::MAX; LANES]),
            rows,
        );
        for (sum, least) in sums.iter_mut().zip(least) {
            *sum += least.to_u32();
        }
    }
}

#[expect(
    clippy::inline_always,
    clippy::cast_possible_truncation,
    reason = "must be compiled with the features of its caller; no window is wider than 1024"
)]
#[inline(always)]
fn rolled_block<C: Lane>(
    x: &[C],
    width: usize,
    limits: &[u32; LANES],
    rows: &mut Rows<C>,
) -> [C; LANES] {
    let Rows { front, behind } = rows;
    let mut least = [C::MAX; LANES];
    for j in 0..width {
        insert_row(front, j, &x[j..]);
        insert_row(behind, j, &x[width + j..]);
        let mut distance = [C::default(); LANES];
        for (front, behind) in front[..=j].iter().zip(&behind[..=j]) {
            for l in 0..LANES {
                distance[l] = distance[l].plus(front[l].distance(behind[l]));
            }
        }
        for l in 0..LANES {
            let nearer = distance[l] < least[l] && (j as u32) < limits[l];
            least[l] = if nearer { distance[l] } else { least[l] };
        }
    }
    for l in 0..LANES {
        least[l] = if limits[l] == 0 {
            C::default()
        } else {
            least[l]
        };
    }
    least
}

/// Inserts one value per lane into the `j` sorted rows.
#[expect(
    clippy::inline_always,
    reason = "must be compiled with the features of its caller"
)]
#[inline(always)]
fn insert_row<C: Lane>(sorted: &mut [[C; LANES]], j: usize, values: &[C]) {
    let mut carry = [C::default(); LANES];
    carry.copy_from_slice(&values[..LANES]);
    for row in &mut sorted[..j] {
        for l in 0..LANES {
            let (low, high) = (row[l].min(carry[l]), row[l].max(carry[l]));
            row[l] = low;
            carry[l] = high;
        }
    }
    sorted[j] = carry;
}
