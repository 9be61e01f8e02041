//! The method on episodes in memory: `extract` whole, on one thread, in time per value (step × column).
//!
//! Left out: reading and writing. Episodes are made outside the timed closures, seeded.

use coact::extraction::{ExtractionParams, Measure, Profile, RawParams, extract};
use coact::model::{Columns, Episode, EpisodeKey};
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
