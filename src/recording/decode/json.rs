//! JSON: `serde_json` walks the text, a seed per wanted field takes the numbers, all else is skipped unread.
//!
//! Numbers are correctly rounded (feature `float_roundtrip`); integers beyond 2^53 become the nearest f64. The depth
//! limit of `serde_json` stays on.

use std::fmt;

use serde::Deserializer;
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::{DecodeError, Field, Plan, Row};

/// Walks `data` and leaves the wanted fields in `row`.
pub(super) fn decode(plan: &Plan, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
    let mut json = serde_json::Deserializer::from_slice(data);
    PlanSeed { plan, row }
        .deserialize(&mut json)
        .and_then(|()| json.end())
        .map_err(|e| error(data, &e))
}

/// An error without the place in the message, which differs from one to the next.
fn error(data: &[u8], e: &serde_json::Error) -> DecodeError {
    if e.is_syntax() && is_nan_token(data, e) {
        return DecodeError::NanToken;
    }
    let text = e.to_string();
    let what = text.split(" at line ").next().unwrap_or(&text).to_owned();
    if e.is_data() {
        DecodeError::WrongType(what)
    } else {
        DecodeError::Malformed {
            encoding: "JSON",
            what,
        }
    }
}

/// Does the parser stand at one of the tokens that Python writes for numbers that are not finite?
fn is_nan_token(data: &[u8], e: &serde_json::Error) -> bool {
    let line_start: usize = data
        .split_inclusive(|&b| b == b'\n')
        .take(e.line().saturating_sub(1))
        .map(<[u8]>::len)
        .sum();
    let at = line_start + e.column();
    (at.saturating_sub(2)..=at).any(|i| {
        data.get(i..)
            .is_some_and(|rest| rest.starts_with(b"NaN") || rest.starts_with(b"Infinity"))
    })
}

/// Walks an object for the names of a plan.
struct PlanSeed<'p, 'r> {
    plan: &'p Plan,
    row: &'r mut Row,
}

impl<'de> DeserializeSeed<'de> for PlanSeed<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        match self.plan.field {
            Some(field) => FieldSeed {
                field,
                row: self.row,
            }
            .deserialize(deserializer),
            None => deserializer.deserialize_any(self),
        }
    }
}

impl<'de> Visitor<'de> for PlanSeed<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Self { plan, row } = self;
        let mut seen = 0u64;
        while let Some(found) = map.next_key_seed(NameSeed(&plan.names))? {
            let Some(index) = found else {
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            let (name, child) = &plan.names[index];
            let bit = 1u64
                .checked_shl(u32::try_from(index).unwrap_or(u32::MAX))
                .unwrap_or(0);
            if seen & bit != 0 {
                return Err(A::Error::custom(format_args!("duplicate key {name:?}")));
            }
            seen |= bit;
            map.next_value_seed(PlanSeed {
                plan: child,
                row: &mut *row,
            })?;
        }
        Ok(())
    }
}

/// Finds a key among the names of a plan.
struct NameSeed<'p>(&'p [(String, Plan)]);

impl<'de> DeserializeSeed<'de> for NameSeed<'_> {
    type Value = Option<usize>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_str(self)
    }
}

impl Visitor<'_> for NameSeed<'_> {
    type Value = Option<usize>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a key")
    }

    fn visit_str<E: Error>(self, key: &str) -> Result<Self::Value, E> {
        Ok(self.0.iter().position(|(name, _)| name == key))
    }
}

/// Takes the value of one wanted field.
struct FieldSeed<'r> {
    field: Field,
    row: &'r mut Row,
}

impl<'de> DeserializeSeed<'de> for FieldSeed<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        let Self { field, row } = self;
        match field {
            Field::Action => {
                row.has_action = true;
                deserializer.deserialize_any(Leaves {
                    name: "action",
                    values: &mut row.action,
                })
            }
            Field::State => {
                row.has_state = true;
                deserializer.deserialize_any(Leaves {
                    name: "state",
                    values: &mut row.state,
                })
            }
            Field::Episode { .. } | Field::Step | Field::Reward | Field::EndFlag => {
                deserializer.deserialize_any(FieldSeed { field, row })
            }
        }
    }
}

impl FieldSeed<'_> {
    fn integer<E: Error>(self, value: i64) -> Result<(), E> {
        match self.field {
            Field::Episode { rank } => self.row.set_id_integer(rank, value),
            Field::Step => self.row.step = Some(value),
            _ => return self.number(value as f64),
        }
        Ok(())
    }

    fn number<E: Error>(self, value: f64) -> Result<(), E> {
        match self.field {
            Field::Reward => self.row.reward = Some(value),
            Field::EndFlag => {
                self.row.has_end_flag = true;
                self.row.ended |= value != 0.0;
            }
            Field::Episode { .. } | Field::Step => {
                return self.integer(
                    whole(value)
                        .ok_or_else(|| E::custom("episode or step is not a whole number"))?,
                );
            }
            Field::Action | Field::State => {}
        }
        Ok(())
    }
}

/// The integer that a float stands for, if it does: some encoders write every number as a float.
fn whole(value: f64) -> Option<i64> {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the range is checked first"
    )]
    (value.fract() == 0.0 && value.abs() <= 9_007_199_254_740_992.0).then_some(value as i64)
}

impl Visitor<'_> for FieldSeed<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.field {
            Field::Episode { .. } => "an integer or a string as episode",
            Field::Step => "an integer as step",
            Field::Reward => "a number as reward",
            Field::EndFlag => "a boolean as terminated, truncated or done",
            Field::Action | Field::State => "numbers",
        })
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        match self.field {
            Field::EndFlag => self.number(f64::from(u8::from(value))),
            _ => Err(E::custom(format_args!(
                "a boolean where {} is expected",
                Expecting(&self)
            ))),
        }
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.integer(value)
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        match i64::try_from(value) {
            Ok(value) => self.integer(value),
            Err(_) => self.number(value as f64),
        }
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        self.number(value)
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<(), E> {
        match self.field {
            Field::Episode { rank } => {
                self.row.set_id_text(rank, value);
                Ok(())
            }
            _ => Err(E::custom(format_args!(
                "text where {} is expected",
                Expecting(&self)
            ))),
        }
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        match self.field {
            // A simulator that has no reward, or no flag, for a step may well say so by null.
            Field::Reward | Field::EndFlag => Ok(()),
            _ => Err(E::custom(format_args!(
                "null where {} is expected",
                Expecting(&self)
            ))),
        }
    }
}

/// What a field expects, as text.
struct Expecting<'a, 'r>(&'a FieldSeed<'r>);

impl fmt::Display for Expecting<'_, '_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.expecting(f)
    }
}

/// Takes all numbers below a value, nested arrays flattened.
struct Leaves<'r> {
    name: &'static str,
    values: &'r mut Vec<f64>,
}

impl<'de> DeserializeSeed<'de> for Leaves<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Leaves<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a number or an array of numbers as {}", self.name)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        self.values.push(f64::from(u8::from(value)));
        Ok(())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.values.push(value as f64);
        Ok(())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        self.values.push(value as f64);
        Ok(())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        self.values.push(value);
        Ok(())
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        Err(E::custom(format_args!(
            "null where a number is expected in {}",
            self.name
        )))
    }

    fn visit_str<E: Error>(self, _: &str) -> Result<(), E> {
        Err(E::custom(format_args!(
            "text where a number is expected in {}",
            self.name
        )))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        while seq
            .next_element_seed(Leaves {
                name: self.name,
                values: &mut *self.values,
            })?
            .is_some()
        {}
        Ok(())
    }
}
