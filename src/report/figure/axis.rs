//! Axes: values to places, and ticks at round numbers.

use super::svg::Svg;

/// Values from `low` to `high` on the places from `start` to `end`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    low: f64,
    high: f64,
    pub(super) start: f64,
    pub(super) end: f64,
}

/// A rectangle with its axis of steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Panel {
    pub(super) x: Axis,
    pub(super) top: f64,
    pub(super) height: f64,
}

/// Room between curves and frame, as a share of the height.
const MARGIN: f64 = 0.08;

/// Ticks on an axis of steps, and of values.
const STEP_TICKS: f64 = 8.0;
const VALUE_TICKS: f64 = 3.0;

impl Axis {
    pub(super) fn new(low: f64, high: f64, start: f64, end: f64) -> Self {
        Self {
            low,
            high,
            start,
            end,
        }
    }

    /// Where a value stands.
    pub(super) fn at(&self, value: f64) -> f64 {
        // Halves, because the difference of two large numbers may be infinite.
        let share = (value / 2.0 - self.low / 2.0) / (self.high / 2.0 - self.low / 2.0);
        self.start + share * (self.end - self.start)
    }

    /// The axis of steps below `y`, with its name.
    pub(super) fn draw_steps(&self, svg: &mut Svg, y: f64) {
        for tick in ticks(self.low, self.high, STEP_TICKS) {
            let x = self.at(tick);
            svg.rule((x, y), (x, y + 4.0), "#808080", false);
            svg.text(x, y + 14.0, "tick", "middle", &number(tick));
        }
        svg.text(
            f64::midpoint(self.start, self.end),
            y + 29.0,
            "name",
            "middle",
            "step",
        );
    }

    /// Ticks of values, to the left.
    pub(super) fn draw_values(&self, svg: &mut Svg) {
        for tick in ticks(self.low, self.high, VALUE_TICKS) {
            self.draw_value(svg, tick);
        }
    }

    /// Ticks at 0, a half and 1.
    pub(super) fn draw_unit(&self, svg: &mut Svg) {
        for tick in [0.0, 0.5, 1.0] {
            self.draw_value(svg, tick);
        }
    }

    fn draw_value(&self, svg: &mut Svg, tick: f64) {
        let y = self.at(tick);
        svg.rule((super::LEFT - 4.0, y), (super::LEFT, y), "#808080", false);
        svg.text(super::LEFT - 7.0, y + 3.0, "tick", "end", &number(tick));
    }
}

impl Panel {
    pub(super) fn new(x: Axis, top: f64, height: f64) -> Self {
        Self { x, top, height }
    }

    /// An axis from the least to the largest of `values`; nothing where there are none.
    pub(super) fn values(&self, values: &[f64]) -> Option<Axis> {
        let low = values.iter().copied().min_by(f64::total_cmp)?;
        let high = values.iter().copied().max_by(f64::total_cmp)?;
        let margin = self.height * MARGIN;
        let (bottom, top) = (self.top + self.height - margin, self.top + margin);
        if low < high {
            return Some(Axis::new(low, high, bottom, top));
        }
        let around = low.abs().max(1.0) / 2.0;
        Some(Axis::new(low - around, high + around, bottom, top))
    }

    /// An axis from 0 to 1.
    pub(super) fn unit(&self) -> Axis {
        let margin = self.height * MARGIN;
        Axis::new(0.0, 1.0, self.top + self.height - margin, self.top + margin)
    }

    pub(super) fn frame(&self, svg: &mut Svg) {
        svg.frame(
            self.x.start,
            self.top,
            self.x.end - self.x.start,
            self.height,
        );
    }

    /// What the panel shows, beside its axis.
    pub(super) fn label(&self, svg: &mut Svg, name: &str, unit: &str) {
        let middle = self.top + self.height / 2.0;
        svg.upright_text(14.0, middle, "name", &shortened(name));
        svg.upright_text(27.0, middle, "tick", unit);
    }
}

/// As much of a name as stands beside a panel.
fn shortened(name: &str) -> String {
    const FITS: usize = 14;
    if name.chars().count() <= FITS {
        return name.to_owned();
    }
    name.chars().take(FITS - 1).chain(['…']).collect()
}

/// Round numbers from `low` to `high`, about `count`.
fn ticks(low: f64, high: f64, count: f64) -> Vec<f64> {
    let rough = (high - low) / count;
    if !(rough.is_finite() && rough > 0.0) {
        return vec![low, high];
    }
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * power)
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(rough);
    let first = (low / step).ceil();
    (0..=20)
        .map(|i| (first + f64::from(i)) * step)
        .take_while(|tick| *tick <= high + step * 1e-9)
        .collect()
}

/// A number as short as it can be read.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.1e}").replace('-', "−");
    }
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside() {
        assert_eq!(ticks(0.0, 99.0, 8.0), [0.0, 20.0, 40.0, 60.0, 80.0]);
        assert_eq!(ticks(-1.0, 1.0, 3.0), [-1.0, 0.0, 1.0]);
        assert_eq!(ticks(f64::MIN, f64::MAX, 3.0), [f64::MIN, f64::MAX]);
    }

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, -0.25, 1e-9, 2e6, 1234.5].map(number);
        assert_eq!(texts, ["0", "−0.25", "1.0e−9", "2.0e6", "1234.5"]);
    }

    #[test]
    fn extremes_have_a_place() {
        let axis = Axis::new(f64::MIN, f64::MAX, 0.0, 100.0);
        assert_eq!(axis.at(0.0), 50.0);
    }
}
