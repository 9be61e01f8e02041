//! The method on episodes in memory: `extract` whole, on one thread, in time per value (step × column).
//!
//! Left out: reading and writing. Episodes are made outside the timed closures, seeded. `naive` has the same measures as
//! plain loops. Results: `benches/README.md`.

use coact::extraction::{ExtractionParams, Measure, Profile, RawParams, extract};
use coact::model::{Columns, Episode, EpisodeKey, Outcome};
use divan::Bencher;
use divan::counter::ItemsCount;

fn main() {
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()
        .expect("the first pool");
    divan::main();
}

/// `SplitMix64`: the same episode on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// Half of the columns drift by small integers, half are noise.
fn episode(n_steps: usize, n_state_dims: usize) -> Episode {
    let mut random = Random(1);
    let mut column = |is_noise: bool| {
        let mut level = 128u8;
        (0..n_steps)
            .map(|_| {
                let draw = random.next();
                if is_noise {
                    return (draw >> 11) as f64 / (1u64 << 53) as f64;
                }
                match draw % 8 {
                    0 => level = level.wrapping_add(1),
                    1 => level = level.wrapping_sub(1),
                    _ => {}
                }
                f64::from(level)
            })
            .collect::<Vec<f64>>()
    };
    let actions = Columns::new(n_steps, vec![column(false)]);
    let states = (0..n_state_dims).map(|c| column(c % 2 == 1)).collect();
    Episode {
        key: EpisodeKey {
            recording: "bench".into(),
            episode: 0,
            episode_id: None,
        },
        env_id: None,
        actions,
        states: Columns::new(n_steps, states),
        joint_names: None,
        times: None,
        rewards: None,
        incomplete: None,
        n_dropped_steps: 0,
    }
}

fn params(measure: Measure, profile: Profile) -> ExtractionParams {
    ExtractionParams::new(RawParams {
        measure,
        profile,
        ..RawParams::default()
    })
    .expect("valid parameters")
}

fn bench(bencher: Bencher<'_, '_>, episode: &Episode, params: &ExtractionParams) {
    let n_values = episode.n_steps() * (episode.states.n_columns() + 1);
    bencher
        .counter(ItemsCount::new(n_values))
        .bench(|| extract(episode, params));
}

/// Each measure, T = 2,000, d = 128.
#[divan::bench(args = Measure::ALL.map(Measure::name))]
fn measure(bencher: Bencher<'_, '_>, name: &str) {
    let measure = name.parse().expect("a measure");
    bench(
        bencher,
        &episode(2_000, 128),
        &params(measure, Profile::Paper),
    );
}

/// The same measures in plain loops, T = 2,000, d = 128; the results are held against each other.
#[divan::bench(name = "naive", args = Measure::ALL.map(Measure::name))]
fn plain_loops(bencher: Bencher<'_, '_>, name: &str) {
    let measure: Measure = name.parse().expect("a measure");
    let episode = episode(2_000, 128);
    let Outcome::Extracted(found) = extract(&episode, &params(measure, Profile::Paper)) else {
        panic!("long enough");
    };
    let naive = naive::mean_measure(&episode.states, measure);
    for (fast, naive) in found.state.measure.iter().zip(&naive) {
        assert!((fast - naive).abs() <= 1e-12, "{name}: {fast} {naive}");
    }
    let n_values = episode.n_steps() * episode.states.n_columns();
    bencher
        .counter(ItemsCount::new(n_values))
        .bench(|| naive::mean_measure(&episode.states, measure));
}

/// The default measure over the number of steps, d = 16.
#[divan::bench(args = [100, 1_000, 10_000, 100_000, 1_000_000])]
fn steps(bencher: Bencher<'_, '_>, n_steps: usize) {
    bench(
        bencher,
        &episode(n_steps, 16),
        &params(Measure::EarthMover, Profile::Paper),
    );
}

/// The default measure over the number of columns, T = 1,000.
#[divan::bench(args = [1, 16, 128, 1_024, 33_600])]
fn columns(bencher: Bencher<'_, '_>, n_state_dims: usize) {
    bench(
        bencher,
        &episode(1_000, n_state_dims),
        &params(Measure::EarthMover, Profile::Paper),
    );
}

/// The default measure at the size that other implementations are compared at: T = 10,000, d = 128.
#[divan::bench(args = ["paper", "authors"])]
fn profile(bencher: Bencher<'_, '_>, name: &str) {
    let profile = if name == "paper" {
        Profile::Paper
    } else {
        Profile::Authors
    };
    bench(
        bencher,
        &episode(10_000, 128),
        &params(Measure::EarthMover, profile),
    );
}

/// The measures as plain loops over windows of f64, without any of the crate: what the figures are held against.
///
/// Straightforward but not silly: edges are searched, probabilities looked up, windows are slices. The whole path of a
/// state (Eq. 1–7, averaged over the columns); nothing is shared between windows.
mod naive {
    use coact::extraction::Measure;
    use coact::model::Columns;

    const BINS: usize = 64;
    const WINDOW: usize = 5;
    const LEFT: usize = WINDOW / 2 + 1;
    const RIGHT: usize = WINDOW - LEFT;

    /// `E_w` with the default parameters.
    pub(super) fn mean_measure(states: &Columns, measure: Measure) -> Vec<f64> {
        let n = states.n_rows();
        let bins: Vec<Vec<usize>> = states.iter().filter_map(bins).collect();
        let mut counts = vec![0usize; BINS];
        bins.iter().flatten().for_each(|&bin| counts[bin] += 1);
        let total = (n * bins.len()) as f64;
        let probabilities: Vec<f64> = counts.iter().map(|&c| c as f64 / total).collect();
        let mut sums = vec![0.0; n];
        for column in &bins {
            let p: Vec<f64> = column.iter().map(|&bin| probabilities[bin]).collect();
            add_column(&p, measure, &mut sums);
        }
        sums.iter().map(|sum| sum / bins.len() as f64).collect()
    }

    fn bins(column: &[f64]) -> Option<Vec<usize>> {
        let min = column.iter().copied().fold(f64::INFINITY, f64::min);
        let max = column.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let width = (max - min) / BINS as f64;
        let edges: Vec<f64> = (1..BINS).map(|k| min + k as f64 * width).collect();
        let bin = |x: &f64| edges.partition_point(|e| e <= x);
        (min < max).then(|| column.iter().map(bin).collect())
    }

    fn add_column(p: &[f64], measure: Measure, sums: &mut [f64]) {
        let n = p.len();
        let window = |t: usize| {
            let t = match t {
                t if t < LEFT => t + LEFT,
                t if t >= n - RIGHT => t - RIGHT,
                t => t,
            };
            &p[t - LEFT..t + RIGHT]
        };
        let r = 0.2 * deviation(p) + 1e-12;
        let of_one: fn(&[f64], f64) -> f64 = match measure {
            Measure::Shannon => |p, _| -p.iter().map(|p| p * p.ln()).sum::<f64>(),
            Measure::Approximate => |p, r| (phi(p, 3, r) - phi(p, 4, r)).abs(),
            Measure::Sample => sample,
            Measure::Permutation => |p, _| permutation(p),
            _ => {
                let of_two: fn(&[f64], &[f64]) -> f64 = match measure {
                    Measure::Kl => kullback_leibler,
                    Measure::JensenShannon => jensen_shannon,
                    Measure::TotalVariation => total_variation,
                    _ => earth_mover,
                };
                for (t, sum) in sums.iter_mut().enumerate() {
                    let other = |j: usize| if t + WINDOW < n { t + j } else { t - j };
                    let least = (1..=WINDOW)
                        .map(|j| of_two(window(t), window(other(j))))
                        .fold(f64::INFINITY, f64::min);
                    *sum += if least <= 1e-14 { 0.0 } else { least };
                }
                return;
            }
        };
        for (t, sum) in sums.iter_mut().enumerate() {
            *sum += of_one(window(t), r);
        }
    }

    fn deviation(p: &[f64]) -> f64 {
        let n = p.len() as f64;
        let mean = p.iter().sum::<f64>() / n;
        (p.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n).sqrt()
    }

    fn similar(a: &[f64], b: &[f64], r: f64) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= r)
    }

    fn phi(p: &[f64], m: usize, r: f64) -> f64 {
        let n = (p.len() - m + 1) as f64;
        p.windows(m)
            .map(|a| (p.windows(m).filter(|b| similar(a, b, r)).count() as f64 / n).ln())
            .sum::<f64>()
            / n
    }

    fn sample(p: &[f64], r: f64) -> f64 {
        let n = p.len() - 2;
        let pairs = |m: usize| {
            let mut count = 0;
            for i in 0..n {
                for k in i + 1..n {
                    count += usize::from(similar(&p[i..i + m], &p[k..k + m], r));
                }
            }
            count as f64
        };
        let (long, short) = (pairs(3), pairs(2));
        if long == 0.0 || short == 0.0 {
            ((n * (n - 1)) as f64 / 2.0).ln()
        } else {
            -(long / short).ln()
        }
    }

    fn permutation(p: &[f64]) -> f64 {
        let mut counts = [0usize; 8];
        for w in p.windows(3) {
            let pattern = [w[1] < w[0], w[2] < w[0], w[2] < w[1]];
            counts[pattern
                .iter()
                .fold(0, |code, &bit| 2 * code + usize::from(bit))] += 1;
        }
        let n = (p.len() - 2) as f64;
        -counts
            .iter()
            .filter(|&&count| count > 0)
            .map(|&count| (count as f64 / n) * (count as f64 / n).log2())
            .sum::<f64>()
    }

    fn kullback_leibler(p: &[f64], q: &[f64]) -> f64 {
        let (sum_p, sum_q) = (p.iter().sum::<f64>(), q.iter().sum::<f64>());
        p.iter()
            .zip(q)
            .map(|(p, q)| p / sum_p * ((p / sum_p) / (q / sum_q)).ln())
            .sum()
    }

    fn jensen_shannon(p: &[f64], q: &[f64]) -> f64 {
        let (sum_p, sum_q) = (p.iter().sum::<f64>(), q.iter().sum::<f64>());
        p.iter()
            .zip(q)
            .map(|(p, q)| {
                let (p, q) = (p / sum_p, q / sum_q);
                let m = 0.5 * (p + q);
                0.5 * (p * (p / m).ln() + q * (q / m).ln())
            })
            .sum()
    }

    fn total_variation(p: &[f64], q: &[f64]) -> f64 {
        let (sum_p, sum_q) = (p.iter().sum::<f64>(), q.iter().sum::<f64>());
        let differences = p.iter().zip(q).map(|(p, q)| (p / sum_p - q / sum_q).abs());
        differences.sum::<f64>() / 2.0
    }

    fn earth_mover(p: &[f64], q: &[f64]) -> f64 {
        let sorted = |window: &[f64]| {
            let mut window = <[f64; WINDOW]>::try_from(window).expect("a window");
            window.sort_unstable_by(f64::total_cmp);
            window
        };
        let pairs = sorted(p).into_iter().zip(sorted(q));
        pairs.map(|(p, q)| (p - q).abs()).sum::<f64>() / WINDOW as f64
    }
}
