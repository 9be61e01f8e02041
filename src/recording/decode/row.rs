//! What one message gives: the values of each wanted field.

use super::DecodeError;
use super::plan::Field;
use crate::recording::limits::MAX_VECTOR_WIDTH;

/// The episode a message says it belongs to; text stands in [`Row::id_text`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum RowId {
    #[default]
    None,
    Integer(i64),
    Text,
}

/// Stands for a value that a message with names does not hold. No number that a decoder reads has these bits: a NaN
/// in a message is refused.
pub(crate) const ABSENT: f64 = f64::from_bits(0x7ff8_c0ac_7000_0001);

/// Is this [`ABSENT`], and not another NaN?
pub(crate) fn is_absent(value: f64) -> bool {
    value.to_bits() == ABSENT.to_bits()
}

/// Texts in one buffer, so that reading them allocates nothing once it has grown.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Names {
    text: String,
    ends: Vec<usize>,
}

impl Names {
    pub(crate) fn clear(&mut self) {
        self.text.clear();
        self.ends.clear();
    }

    pub(crate) fn push(&mut self, name: &str) {
        self.text.push_str(name);
        self.ends.push(self.text.len());
    }

    /// Adds all of another's: two copies, whatever their number.
    pub(super) fn append(&mut self, other: &Self) {
        let start = self.text.len();
        self.text.push_str(&other.text);
        self.ends.extend(other.ends.iter().map(|end| start + end));
    }

    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Are these the same names, in any order?
    pub(crate) fn are(&self, names: &[String]) -> bool {
        self.len() == names.len() && self.iter().all(|name| names.iter().any(|n| n == name))
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &str> {
        let mut start = 0;
        self.ends.iter().map(move |&end| {
            let name = &self.text[start..end];
            start = end;
            name
        })
    }
}

/// The values of one selector, or of several that pick from the same field by name.
#[derive(Debug, Clone, Default)]
pub(crate) struct Target {
    /// What it is for, as messages call it: `action`, `state`.
    pub(crate) label: &'static str,
    pub(crate) values: Vec<f64>,
    pub(crate) names: Names,
    /// The field was there.
    pub(crate) found: bool,
    /// Fewest values it must have; 0 if only its names are wanted.
    pub(crate) min_len: usize,
}

/// All of a row but its values, names and text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Head {
    id: RowId,
    step: Option<i64>,
    reward: Option<f64>,
    ended: bool,
    has_end_flag: bool,
    has_end_field: bool,
    stamp: (Option<i64>, i64),
}

/// The values of one message. A decoder that fails leaves what it had read by then.
#[derive(Debug, Clone, Default)]
pub(crate) struct Row {
    pub(crate) targets: Vec<Target>,
    pub(crate) id: RowId,
    pub(crate) id_text: String,
    id_rank: u8,
    pub(crate) step: Option<i64>,
    pub(crate) reward: Option<f64>,
    /// Any of the end flags was true.
    pub(crate) ended: bool,
    /// Any of the end flags was there.
    pub(crate) has_end_flag: bool,
    /// One was there, or a null in its place.
    pub(crate) has_end_field: bool,
    stamp_seconds: Option<i64>,
    stamp_nanos: i64,
}

impl Row {
    /// A row with one target for each label.
    #[cfg(test)]
    pub(crate) fn new(labels: &[&'static str]) -> Self {
        let labels: Vec<_> = labels.iter().map(|&label| (label, 1)).collect();
        Self::with_targets(&labels)
    }

    /// A row with one target for each label, which must get at least so many values.
    pub(crate) fn with_targets(labels: &[(&'static str, usize)]) -> Self {
        let target = |&(label, min_len)| Target {
            label,
            min_len,
            ..Target::default()
        };
        Self {
            targets: labels.iter().map(target).collect(),
            ..Self::default()
        }
    }

    /// Does it have these targets?
    pub(crate) fn has_targets(&self, targets: &[(&'static str, usize)]) -> bool {
        self.targets.len() == targets.len()
            && self
                .targets
                .iter()
                .zip(targets)
                .all(|(t, &(label, min_len))| t.label == label && t.min_len == min_len)
    }

    pub(crate) fn clear(&mut self) {
        for target in &mut self.targets {
            target.values.clear();
            target.names.clear();
            target.found = false;
        }
        self.id = RowId::None;
        self.id_text.clear();
        self.step = None;
        self.reward = None;
        self.ended = false;
        self.has_end_flag = false;
        self.has_end_field = false;
        self.stamp_seconds = None;
        self.stamp_nanos = 0;
    }

    /// All but values, names and text.
    pub(crate) fn head(&self) -> Head {
        Head {
            id: self.id,
            step: self.step,
            reward: self.reward,
            ended: self.ended,
            has_end_flag: self.has_end_flag,
            has_end_field: self.has_end_field,
            stamp: (self.stamp_seconds, self.stamp_nanos),
        }
    }

    /// Becomes the row of a message that was decoded elsewhere, but for its values and names.
    pub(crate) fn set_head(&mut self, head: &Head, id_text: &str) {
        self.clear();
        self.id = head.id;
        self.id_text.push_str(id_text);
        self.step = head.step;
        self.reward = head.reward;
        self.ended = head.ended;
        self.has_end_flag = head.has_end_flag;
        self.has_end_field = head.has_end_field;
        (self.stamp_seconds, self.stamp_nanos) = head.stamp;
    }

    /// The message's own time, nanoseconds since the Unix epoch.
    pub(crate) fn stamp(&self) -> Option<i64> {
        self.stamp_seconds?
            .checked_mul(1_000_000_000)?
            .checked_add(self.stamp_nanos)
    }

    /// Where the values of a target go; the field counts as found.
    pub(super) fn values(&mut self, target: usize) -> &mut Vec<f64> {
        let target = &mut self.targets[target];
        target.found = true;
        &mut target.values
    }

    /// Where the names of a target go.
    pub(super) fn names(&mut self, target: usize) -> &mut Names {
        &mut self.targets[target].names
    }

    /// Takes an integer for `field`. Integers beyond 2^53 become the nearest f64 where a number is wanted.
    pub(super) fn integer(&mut self, field: Field, value: i64) -> Result<(), DecodeError> {
        match field {
            Field::Episode { rank } => {
                if self.takes_id(rank) {
                    self.id = RowId::Integer(value);
                }
            }
            Field::Step => self.step = Some(value),
            Field::StampSeconds => self.stamp_seconds = Some(value),
            Field::StampNanos => self.stamp_nanos = value,
            _ => return self.float(field, value as f64),
        }
        Ok(())
    }

    /// Takes an unsigned integer.
    pub(super) fn unsigned(&mut self, field: Field, value: u64) -> Result<(), DecodeError> {
        match i64::try_from(value) {
            Ok(value) => self.integer(field, value),
            Err(_) => self.float(field, value as f64),
        }
    }

    /// Takes a float; whole ones also where an integer is wanted, since some encoders write every number so.
    pub(super) fn float(&mut self, field: Field, value: f64) -> Result<(), DecodeError> {
        match field {
            Field::Values(target) => self.values(target).push(value),
            Field::Reward => self.reward = Some(value),
            Field::EndFlag => {
                self.has_end_flag = true;
                self.has_end_field = true;
                self.ended |= value != 0.0;
            }
            Field::Episode { .. } | Field::Step | Field::StampSeconds | Field::StampNanos => {
                return match whole(value) {
                    Some(value) => self.integer(field, value),
                    None => Err(DecodeError::wrong_type(
                        "a number that is not whole",
                        field,
                        self,
                    )),
                };
            }
            Field::Names(_) => return Err(DecodeError::wrong_type("a number", field, self)),
        }
        Ok(())
    }

    pub(super) fn boolean(&mut self, field: Field, value: bool) -> Result<(), DecodeError> {
        match field {
            Field::EndFlag | Field::Values(_) => self.float(field, f64::from(u8::from(value))),
            _ => Err(DecodeError::wrong_type("a boolean", field, self)),
        }
    }

    pub(super) fn text(&mut self, field: Field, value: &str) -> Result<(), DecodeError> {
        match field {
            Field::Episode { rank } => {
                if self.takes_id(rank) {
                    self.id = RowId::Text;
                    self.id_text.clear();
                    self.id_text.push_str(value);
                }
            }
            Field::Names(target) => self.targets[target].names.push(value),
            _ => return Err(DecodeError::wrong_type("text", field, self)),
        }
        Ok(())
    }

    /// Takes a null. A simulator that has no reward, or no flag, for a step may well say so by it.
    pub(super) fn null(&mut self, field: Field) -> Result<(), DecodeError> {
        match field {
            Field::Reward => Ok(()),
            Field::EndFlag => {
                self.has_end_field = true;
                Ok(())
            }
            _ => Err(DecodeError::wrong_type("null", field, self)),
        }
    }

    fn takes_id(&mut self, rank: u8) -> bool {
        let takes = self.id == RowId::None || rank < self.id_rank;
        if takes {
            self.id_rank = rank;
        }
        takes
    }

    /// What a field is called in messages.
    pub(super) fn label(&self, field: Field) -> &'static str {
        match field {
            Field::Values(target) | Field::Names(target) => {
                self.targets.get(target).map_or("field", |t| t.label)
            }
            Field::Episode { .. } => "episode",
            Field::Step => "step",
            Field::Reward => "reward",
            Field::EndFlag => "terminated, truncated or done",
            Field::StampSeconds | Field::StampNanos => "time stamp",
        }
    }

    /// Holds the targets against what the values of a step must be.
    pub(super) fn check(&self) -> Result<(), DecodeError> {
        for target in &self.targets {
            let Target {
                label,
                values,
                min_len,
                ..
            } = target;
            if *min_len == 0 {
                continue;
            }
            if !target.found {
                return Err(DecodeError::Missing(label));
            }
            if values.is_empty() {
                return Err(DecodeError::Empty(label));
            }
            if values.len() < *min_len {
                return Err(DecodeError::TooNarrow(label));
            }
            if values.len() > MAX_VECTOR_WIDTH {
                return Err(DecodeError::TooWide(label));
            }
            // All are looked at, whatever comes first: that becomes vector instructions.
            let are_numbers = |all: bool, &v: &f64| all & (v.is_finite() | is_absent(v));
            if !values.iter().fold(true, are_numbers) {
                return Err(DecodeError::NotFinite(label));
            }
        }
        Ok(())
    }
}

/// The integer that a float stands for, if it does.
fn whole(value: f64) -> Option<i64> {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the range is checked first"
    )]
    (value.fract() == 0.0 && value.abs() <= 9_007_199_254_740_992.0).then_some(value as i64)
}
