//! The parameters of the method, checked once: only valid ones can be made.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::model::JointMode;

/// Default number of bins, b.
pub const DEFAULT_BINS: usize = 64;
/// Default window, w, in steps.
pub const DEFAULT_WINDOW: usize = 5;
/// Default threshold on the normalised measure, λ.
pub const DEFAULT_THRESHOLD: f64 = 0.5;
/// Default m of approximate entropy.
pub const DEFAULT_APPROXIMATE_ORDER: usize = 3;
/// Default m of sample entropy.
pub const DEFAULT_SAMPLE_ORDER: usize = 2;
/// Default ordinal order of permutation entropy.
pub const DEFAULT_PERMUTATION_ORDER: usize = 3;

/// Allowed numbers of bins.
pub const BINS: RangeInclusive<usize> = 2..=65_536;
/// Allowed windows, steps.
pub const WINDOWS: RangeInclusive<usize> = 2..=1024;
/// Allowed orders.
pub const ORDERS: RangeInclusive<usize> = 1..=16;

/// The measure of change, f in Eq. 5–7.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measure {
    /// Shannon entropy, nats.
    Shannon,
    /// Approximate entropy, nats.
    Approximate,
    /// Sample entropy, nats.
    Sample,
    /// Permutation entropy, bits.
    Permutation,
    /// Kullback-Leibler divergence, nats.
    Kl,
    /// Jensen-Shannon divergence, nats.
    JensenShannon,
    /// Total variation distance.
    TotalVariation,
    /// Earth mover (1-Wasserstein) distance of the windows as samples, in units of probability.
    #[default]
    EarthMover,
}

impl Measure {
    /// All eight, in the order of the paper.
    pub const ALL: [Self; 8] = [
        Self::Shannon,
        Self::Approximate,
        Self::Sample,
        Self::Permutation,
        Self::Kl,
        Self::JensenShannon,
        Self::TotalVariation,
        Self::EarthMover,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Shannon => "shannon",
            Self::Approximate => "approximate",
            Self::Sample => "sample",
            Self::Permutation => "permutation",
            Self::Kl => "kl",
            Self::JensenShannon => "jensen-shannon",
            Self::TotalVariation => "total-variation",
            Self::EarthMover => "earth-mover",
        }
    }

    /// Its name in the authors' program, an alias on the command line.
    pub fn short_name(self) -> &'static str {
        match self {
            Self::Shannon => "s",
            Self::Approximate => "ae",
            Self::Sample => "se",
            Self::Permutation => "p",
            Self::Kl => "kld",
            Self::JensenShannon => "js",
            Self::TotalVariation => "tv",
            Self::EarthMover => "w",
        }
    }

    /// The unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Shannon | Self::Approximate | Self::Sample | Self::Kl | Self::JensenShannon => {
                "nats"
            }
            Self::Permutation => "bits",
            Self::TotalVariation => "1",
            Self::EarthMover => "probability",
        }
    }

    /// The order it has if none is given; `None` for measures without one.
    pub fn default_order(self) -> Option<usize> {
        match self {
            Self::Approximate => Some(DEFAULT_APPROXIMATE_ORDER),
            Self::Sample => Some(DEFAULT_SAMPLE_ORDER),
            Self::Permutation => Some(DEFAULT_PERMUTATION_ORDER),
            _ => None,
        }
    }

    /// Does it count matches within a tolerance?
    pub fn has_tolerance(self) -> bool {
        matches!(self, Self::Approximate | Self::Sample)
    }
}

impl fmt::Display for Measure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Measure {
    type Err = ParamsError;

    fn from_str(text: &str) -> Result<Self, ParamsError> {
        Self::ALL
            .into_iter()
            .find(|m| m.name() == text || m.short_name() == text)
            .ok_or_else(|| ParamsError::UnknownMeasure(text.to_owned()))
    }
}

/// Whose rules hold where the paper and its authors' program differ (README, "Two profiles").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// The paper's equations, with ties decided by rule.
    #[default]
    Paper,
    /// What the authors' published program does, to its last bit.
    Authors,
}

impl Profile {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Authors => "authors",
        }
    }
}

/// Parameters as asked for, not yet checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawParams {
    /// f
    pub measure: Measure,
    /// Whose rules.
    pub profile: Profile,
    /// b
    pub bins: usize,
    /// w, steps
    pub window: usize,
    /// λ
    pub threshold: f64,
    /// Each joint on its own, or all as one.
    pub joints: JointMode,
    /// m of approximate and sample entropy, ordinal order of permutation entropy.
    pub order: Option<usize>,
    /// r of approximate and sample entropy, absolute.
    pub tolerance: Option<f64>,
}

impl Default for RawParams {
    fn default() -> Self {
        Self {
            measure: Measure::default(),
            profile: Profile::default(),
            bins: DEFAULT_BINS,
            window: DEFAULT_WINDOW,
            threshold: DEFAULT_THRESHOLD,
            joints: JointMode::default(),
            order: None,
            tolerance: None,
        }
    }
}

/// A parameter that cannot be.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ParamsError {
    /// No such measure.
    #[error(
        "unknown measure {0:?}: expected one of shannon, approximate, sample, permutation, kl, jensen-shannon, total-variation, earth-mover"
    )]
    UnknownMeasure(String),
    /// b out of range.
    #[error("bins is {0}: expected 2 to 65536")]
    Bins(usize),
    /// w out of range.
    #[error("window is {0}: expected 2 to 1024 steps")]
    Window(usize),
    /// λ out of range.
    #[error("threshold is {0}: expected at least 0 and less than 1")]
    Threshold(f64),
    /// m out of range.
    #[error("order is {0}: expected 1 to 16")]
    Order(usize),
    /// An order for a measure that has none.
    #[error("order is given, but {0} has none (approximate, sample and permutation have)")]
    NoOrder(Measure),
    /// r out of range.
    #[error("tolerance is {0}: expected a finite number that is not negative")]
    Tolerance(f64),
    /// A tolerance for a measure that has none.
    #[error("tolerance is given, but {0} has none (approximate and sample have)")]
    NoTolerance(Measure),
    /// The window holds too few values for the order.
    #[error(
        "window is {window}, which holds {width} values: {measure} of order {order} needs at least {needed}"
    )]
    WindowTooSmall {
        /// w
        window: usize,
        /// W
        width: usize,
        /// f
        measure: Measure,
        /// m
        order: usize,
        /// The least W.
        needed: usize,
    },
}

/// Parameters that can run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtractionParams {
    raw: RawParams,
    order: usize,
}

impl ExtractionParams {
    /// Checks `raw`.
    ///
    /// # Errors
    /// The first parameter that is out of its range or does not go with the measure.
    pub fn new(raw: RawParams) -> Result<Self, ParamsError> {
        let RawParams {
            measure,
            bins,
            window,
            threshold,
            order,
            tolerance,
            ..
        } = raw;
        if !BINS.contains(&bins) {
            return Err(ParamsError::Bins(bins));
        }
        if !WINDOWS.contains(&window) {
            return Err(ParamsError::Window(window));
        }
        if !(0.0..1.0).contains(&threshold) {
            return Err(ParamsError::Threshold(threshold));
        }
        if let Some(r) = tolerance {
            if !measure.has_tolerance() {
                return Err(ParamsError::NoTolerance(measure));
            }
            if !r.is_finite() || r < 0.0 {
                return Err(ParamsError::Tolerance(r));
            }
        }
        let order = match (order, measure.default_order()) {
            (Some(_), None) => return Err(ParamsError::NoOrder(measure)),
            (Some(m), Some(_)) if !ORDERS.contains(&m) => return Err(ParamsError::Order(m)),
            (given, default) => given.or(default).unwrap_or(0),
        };
        let params = Self { raw, order };
        let needed = match measure {
            Measure::Approximate | Measure::Sample => order + 2,
            Measure::Permutation => order,
            _ => 0,
        };
        let width = params.window_width();
        if width < needed {
            return Err(ParamsError::WindowTooSmall {
                window,
                width,
                measure,
                order,
                needed,
            });
        }
        Ok(params)
    }

    /// f
    pub fn measure(&self) -> Measure {
        self.raw.measure
    }

    /// Whose rules.
    pub fn profile(&self) -> Profile {
        self.raw.profile
    }

    /// b
    pub fn bins(&self) -> usize {
        self.raw.bins
    }

    /// w, steps
    pub fn window(&self) -> usize {
        self.raw.window
    }

    /// λ
    pub fn threshold(&self) -> f64 {
        self.raw.threshold
    }

    /// Each joint on its own, or all as one.
    pub fn joints(&self) -> JointMode {
        self.raw.joints
    }

    /// m, or the ordinal order; 0 for measures without one.
    pub fn order(&self) -> usize {
        self.order
    }

    /// r, if it was given.
    pub fn tolerance(&self) -> Option<f64> {
        self.raw.tolerance
    }

    /// `w_l`: steps of a window before its own (Eq. 4).
    pub fn left(&self) -> usize {
        self.raw.window / 2 + 1
    }

    /// `w_r`: steps of a window from its own on (Eq. 4).
    pub fn right(&self) -> usize {
        match self.raw.profile {
            Profile::Paper => self.raw.window - self.left(),
            Profile::Authors => self.raw.window / 2,
        }
    }

    /// W: values in a window; `w`, but `w + 1` for even `w` in profile `authors`.
    pub fn window_width(&self) -> usize {
        self.left() + self.right()
    }

    /// The largest j of Eq. 7.
    pub fn neighbours(&self) -> usize {
        match self.raw.profile {
            Profile::Paper => self.raw.window,
            Profile::Authors => self.window_width() - 1,
        }
    }

    /// The least number of steps of an episode, `2·W + 1`.
    pub fn min_steps(&self) -> usize {
        2 * self.window_width() + 1
    }
}
