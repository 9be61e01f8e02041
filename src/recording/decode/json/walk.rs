//! The walk of a message beside its plan. What it takes, and what it refuses, is what the seeds of `tree.rs` do.

use super::error::{Malformed, Stop};
use super::number::Number;
use super::scan::Scanner;
use crate::recording::MAX_DEPTH;
use crate::recording::decode::DecodeError;
use crate::recording::decode::plan::{Field, Leaf, Node, Template};
use crate::recording::decode::row::{ABSENT, Row};
use crate::recording::decode::tree::Seen;

/// Buffers of a walk; once they have grown, a message allocates nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// A string that has escapes.
    text: Vec<u8>,
    /// The members of the objects that are open, in the order in which they came.
    members: Vec<Member>,
    /// Values while they are put in order.
    values: Vec<f64>,
}

/// Where the values of a member of a template came to lie.
#[derive(Debug, Clone, Copy)]
struct Member {
    /// Its place in the template.
    index: usize,
    start: usize,
    end: usize,
}

/// One walk over one message.
pub(super) struct Walk<'a, 's> {
    scan: Scanner<'a>,
    scratch: &'s mut Scratch,
    /// How many levels may still be opened; the last one counts as too many.
    depth_left: usize,
}

/// What the numbers of a leaf are taken by.
#[derive(Clone, Copy)]
struct Leaves<'p> {
    label: &'static str,
    template: Option<&'p Template>,
}

impl<'a, 's> Walk<'a, 's> {
    pub(super) fn new(scan: Scanner<'a>, scratch: &'s mut Scratch) -> Self {
        // An earlier walk may have stopped inside of objects.
        scratch.members.clear();
        Self {
            scan,
            scratch,
            depth_left: MAX_DEPTH,
        }
    }

    /// Where the walk stands, or stopped.
    pub(super) fn offset(&self) -> usize {
        self.scan.offset()
    }

    /// The whole message.
    pub(super) fn message(&mut self, node: &Node, row: &mut Row) -> Result<(), Stop> {
        self.node(node, row, false)?;
        Ok(self.scan.end()?)
    }

    /// Takes what `node` wants of the value that comes. `in_array`: inside an array that a name was applied to, where
    /// a member that is missing is [`ABSENT`].
    fn node(&mut self, node: &Node, row: &mut Row, in_array: bool) -> Result<(), Stop> {
        if let Some(leaf) = &node.leaf {
            return self.leaf(leaf, row);
        }
        match self.scan.token() {
            b'{' => {
                self.open()?;
                if !node.items.is_empty() {
                    let what = "an object where an array is expected".to_owned();
                    return Err(Stop::wrong_type(what));
                }
                self.object(node, row, in_array)?;
            }
            b'[' => {
                self.open()?;
                self.array(node, row)?;
            }
            _ => {
                let found = self.pass_scalar()?;
                let expected = if node.items.is_empty() {
                    "an object"
                } else {
                    "an array"
                };
                let what = format!("{found} where {expected} is expected");
                return Err(Stop::wrong_type(what));
            }
        }
        self.depth_left += 1;
        Ok(())
    }

    fn object(&mut self, node: &Node, row: &mut Row, in_array: bool) -> Result<(), Stop> {
        let mut seen = Seen::default();
        let mut is_first = true;
        while self.scan.next_member(is_first)? {
            is_first = false;
            let Some(index) = self.key(&node.keys)? else {
                self.scan.colon()?;
                self.scan.skip()?;
                continue;
            };
            let (key, child) = &node.keys[index];
            if !seen.insert(index) {
                return Err(duplicate(key));
            }
            self.scan.colon()?;
            self.node(child, row, in_array)?;
        }
        if in_array {
            for (index, (_, child)) in node.keys.iter().enumerate() {
                if !seen.contains(index)
                    && let Some(Leaf {
                        field: Field::Values(target),
                        ..
                    }) = child.leaf
                {
                    row.values(target).push(ABSENT);
                }
            }
        }
        Ok(())
    }

    fn array(&mut self, node: &Node, row: &mut Row) -> Result<(), Stop> {
        let mut index = 0;
        while self.scan.next_element(index == 0)? {
            match node.item(index) {
                Some(child) => self.node(child, row, true)?,
                None => self.scan.skip()?,
            }
            index += 1;
        }
        Ok(())
    }

    fn leaf(&mut self, leaf: &Leaf, row: &mut Row) -> Result<(), Stop> {
        let field = leaf.field;
        let Field::Values(target) = field else {
            return self.scalar(field, row);
        };
        let leaves = Leaves {
            label: row.label(field),
            template: leaf.template.as_deref(),
        };
        self.leaves(leaves, row.values(target))
    }

    /// Takes an id, a number, a flag, or a list of names.
    fn scalar(&mut self, field: Field, row: &mut Row) -> Result<(), Stop> {
        match self.scan.token() {
            b'-' | b'0'..=b'9' => match self.scan.number()? {
                Number::Integer(value) => row.integer(field, value)?,
                Number::Float(value) => row.float(field, value)?,
            },
            b'"' => row.text(field, self.scan.text(&mut self.scratch.text)?)?,
            b't' => {
                self.scan.literal(b"true")?;
                row.boolean(field, true)?;
            }
            b'f' => {
                self.scan.literal(b"false")?;
                row.boolean(field, false)?;
            }
            b'n' => {
                self.scan.literal(b"null")?;
                row.null(field)?;
            }
            b'[' => {
                self.open()?;
                if !matches!(field, Field::Names(_)) {
                    return Err(DecodeError::wrong_type("an array", field, row).into());
                }
                self.names(field, row)?;
                self.depth_left += 1;
            }
            b'{' => {
                self.open()?;
                return Err(DecodeError::wrong_type("an object", field, row).into());
            }
            _ => return Err(self.no_value().into()),
        }
        Ok(())
    }

    fn names(&mut self, field: Field, row: &mut Row) -> Result<(), Stop> {
        let mut is_first = true;
        while self.scan.next_element(is_first)? {
            is_first = false;
            match self.scan.token() {
                b'"' => row.text(field, self.scan.text(&mut self.scratch.text)?)?,
                b'[' => return Err(DecodeError::wrong_type("an array", field, row).into()),
                b'{' => return Err(DecodeError::wrong_type("an object", field, row).into()),
                _ => {
                    let found = self.pass_scalar()?;
                    return Err(DecodeError::wrong_type(found, field, row).into());
                }
            }
        }
        Ok(())
    }

    /// Takes all numbers below a value, nested arrays flattened, objects in the order of a template.
    fn leaves(&mut self, leaves: Leaves, values: &mut Vec<f64>) -> Result<(), Stop> {
        match self.scan.token() {
            b'-' | b'0'..=b'9' => values.push(self.scan.float()?),
            b'[' => {
                self.open()?;
                self.leaves_of_array(leaves, values)?;
                self.depth_left += 1;
            }
            b'{' => {
                self.open()?;
                let Some(Template::Object(members)) = leaves.template else {
                    return Err(refuse("an object", leaves.label));
                };
                self.leaves_of_object(leaves.label, members, values)?;
                self.depth_left += 1;
            }
            b't' => {
                self.scan.literal(b"true")?;
                values.push(1.0);
            }
            b'f' => {
                self.scan.literal(b"false")?;
                values.push(0.0);
            }
            _ => {
                let found = self.pass_scalar()?;
                return Err(refuse(found, leaves.label));
            }
        }
        Ok(())
    }

    fn leaves_of_array(&mut self, leaves: Leaves, values: &mut Vec<f64>) -> Result<(), Stop> {
        let (mut is_first, mut all_natural) = (true, true);
        while self.scan.next_element(is_first)? {
            is_first = false;
            match self.scan.fast_float(&mut all_natural) {
                Some(value) => values.push(value),
                None => self.leaves(leaves, values)?,
            }
        }
        Ok(())
    }

    fn leaves_of_object(
        &mut self,
        label: &'static str,
        template: &[(String, Template)],
        values: &mut Vec<f64>,
    ) -> Result<(), Stop> {
        let first_member = self.scratch.members.len();
        let mut is_first = true;
        while self.scan.next_member(is_first)? {
            is_first = false;
            let wanted = self
                .key(template)?
                .map(|index| (index, &template[index].1))
                .filter(|(_, below)| below.has_numbers());
            let Some((index, below)) = wanted else {
                self.scan.colon()?;
                self.scan.skip()?;
                continue;
            };
            let came = &self.scratch.members[first_member..];
            if came.iter().any(|member| member.index == index) {
                return Err(duplicate(&template[index].0));
            }
            self.scan.colon()?;
            let start = values.len();
            let leaves = Leaves {
                label,
                template: Some(below),
            };
            self.leaves(leaves, values)?;
            let end = values.len();
            self.scratch.members.push(Member { index, start, end });
        }
        let n_wanted = template.iter().filter(|(_, b)| b.has_numbers()).count();
        if self.scratch.members.len() - first_member < n_wanted {
            return Err(Stop::wrong_type(format!(
                "a member of {label} that the first message has is missing"
            )));
        }
        self.put_in_order(first_member, values);
        Ok(())
    }

    /// Puts the values of the members from `first_member` on, which are the last ones, in the template's order.
    fn put_in_order(&mut self, first_member: usize, values: &mut Vec<f64>) {
        let Scratch {
            members,
            values: ordered,
            ..
        } = &mut *self.scratch;
        let came = &mut members[first_member..];
        if !came.is_sorted_by_key(|member| member.index) {
            let start = came.first().map_or(values.len(), |member| member.start);
            came.sort_unstable_by_key(|member| member.index);
            ordered.clear();
            for member in came {
                ordered.extend_from_slice(&values[member.start..member.end]);
            }
            values.truncate(start);
            values.extend_from_slice(ordered);
        }
        members.truncate(first_member);
    }

    /// Reads a key and finds it among names.
    #[inline]
    fn key<T>(&mut self, names: &[(String, T)]) -> Result<Option<usize>, Malformed> {
        let key = self.scan.text(&mut self.scratch.text)?;
        Ok(names.iter().position(|(name, _)| name == key))
    }

    /// Passes the bracket or brace that was seen.
    #[inline]
    fn open(&mut self) -> Result<(), Malformed> {
        self.depth_left -= 1;
        if self.depth_left == 0 {
            return Err(Malformed::TooDeep);
        }
        self.scan.advance(1);
        Ok(())
    }

    /// Passes a value that is neither array nor object and stands where none is wanted, and says what it is.
    #[cold]
    fn pass_scalar(&mut self) -> Result<&'static str, Malformed> {
        Ok(match self.scan.token() {
            b'"' => {
                self.scan.text(&mut self.scratch.text)?;
                "text"
            }
            b'-' | b'0'..=b'9' => {
                self.scan.float()?;
                "a number"
            }
            b'n' => {
                self.scan.literal(b"null")?;
                "null"
            }
            b't' => {
                self.scan.literal(b"true")?;
                "a boolean"
            }
            b'f' => {
                self.scan.literal(b"false")?;
                "a boolean"
            }
            _ => return Err(self.no_value()),
        })
    }

    #[cold]
    fn no_value(&self) -> Malformed {
        self.scan
            .unexpected(Malformed::EndInValue, Malformed::ExpectedValue)
    }
}

#[cold]
fn refuse(found: &str, label: &str) -> Stop {
    Stop::wrong_type(format!("{found} where a number is expected in {label}"))
}

#[cold]
fn duplicate(key: &str) -> Stop {
    Stop::wrong_type(format!("duplicate key {key:?}"))
}
