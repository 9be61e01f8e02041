//! Holds what is wanted against the types: what fits is taken, what does not is refused if it is required.

use std::ops::Range;

use super::super::plan::{Field, Leaf, Node};
use super::plan::{CompileError, Compiler};
use super::program::{Count, Pick};
use super::schema::{Member, Number, Shape, Struct, Type, Types};

/// Most fields that an error lists.
const LISTED_FIELDS: usize = 12;

/// What is wanted of a value.
#[derive(Debug, Clone, Copy)]
pub(super) enum Want<'n> {
    Nothing,
    /// All numbers below, for this target.
    Leaves {
        target: usize,
        required: bool,
    },
    Node(&'n Node),
}

/// Where in the types a value stands, for errors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'t> {
    owner: Option<&'t Struct>,
    name: &'t str,
    ty: Type,
    shape: Shape,
}

impl<'t> Place<'t> {
    pub(super) fn root(types: &'t Types) -> Self {
        Self {
            owner: None,
            name: &types.structs[types.root].name,
            ty: Type::Struct(types.root),
            shape: Shape::One,
        }
    }

    pub(super) fn of(owner: &'t Struct, member: &'t Member) -> Self {
        Self {
            owner: Some(owner),
            name: &member.name,
            ty: member.ty,
            shape: member.shape,
        }
    }
}

impl<'t> Compiler<'t> {
    /// What remains wanted of a value, or of the elements of an array, of type `ty`.
    pub(super) fn settle<'n>(
        &self,
        ty: Type,
        want: Want<'n>,
        place: Place<'t>,
    ) -> Result<Want<'n>, CompileError> {
        let has_numbers = self.types.has_numbers(ty);
        match want {
            Want::Leaves { .. } if !has_numbers => Ok(Want::Nothing),
            Want::Node(node) => match &node.leaf {
                Some(Leaf {
                    field: Field::Values(target),
                    required,
                    ..
                }) => {
                    if !has_numbers {
                        self.refuse(node, place, "which holds no numbers to take")?;
                        return Ok(Want::Nothing);
                    }
                    Ok(Want::Leaves {
                        target: *target,
                        required: *required,
                    })
                }
                None if node.keys.is_empty() && node.items.is_empty() => Ok(Want::Nothing),
                _ => Ok(want),
            },
            other => Ok(other),
        }
    }

    /// What is wanted of each member of a struct.
    pub(super) fn wanted_members<'n>(
        &self,
        index: usize,
        want: Want<'n>,
        place: Place<'t>,
    ) -> Result<Vec<Want<'n>>, CompileError> {
        let Want::Node(node) = want else {
            return Ok(Vec::new());
        };
        let of = &self.types.structs[index];
        let mut wanted = vec![Want::Nothing; of.members.len()];
        if !node.items.is_empty() {
            self.refuse(node, place, "of which no elements can be picked")?;
        }
        if node.leaf.is_some() {
            self.refuse(node, place, "where one value is expected")?;
        }
        for (key, child) in &node.keys {
            match position(of, key) {
                Some(i) if matches!(wanted[i], Want::Nothing) => wanted[i] = Want::Node(child),
                _ if !child.is_required() => {}
                Some(_) => {
                    let text = format!("{key:?} of {} is taken under another name too", of.name);
                    return Err(CompileError::Path(text));
                }
                None => return Err(CompileError::Path(missing(of, key))),
            }
        }
        Ok(wanted)
    }

    /// The leaf that takes one value that is no struct.
    pub(super) fn scalar(
        &self,
        ty: Type,
        want: Want<'_>,
        place: Place<'t>,
    ) -> Result<Option<Leaf>, CompileError> {
        let node = match want {
            Want::Nothing => return Ok(None),
            Want::Leaves { target, required } => return Ok(Some(values_leaf(target, required))),
            Want::Node(node) => node,
        };
        match &node.leaf {
            Some(leaf) if fits(ty, leaf.field) => return Ok(Some(leaf.clone())),
            Some(leaf) => self.refuse(node, place, expected(leaf.field))?,
            None if node.items.is_empty() => self.refuse(node, place, "which has no fields")?,
            None => self.refuse(node, place, "of which no elements can be picked")?,
        }
        Ok(None)
    }

    /// The elements that are taken of an array of what is no struct, in their order.
    pub(super) fn picks(
        &mut self,
        ty: Type,
        count: Count,
        want: Want<'_>,
        place: Place<'t>,
    ) -> Result<Vec<Pick>, CompileError> {
        let all = match count {
            Count::Fixed(n) => 0..n,
            Count::Sequence => 0..usize::MAX,
        };
        let mut found: Vec<(Range<usize>, Leaf)> = Vec::new();
        match want {
            Want::Nothing => {}
            Want::Leaves { target, required } => found.push((all, values_leaf(target, required))),
            Want::Node(node) => match &node.leaf {
                Some(leaf) if matches!(leaf.field, Field::Names(_)) && fits(ty, leaf.field) => {
                    found.push((all, leaf.clone()));
                }
                Some(leaf) => self.refuse(node, place, expected(leaf.field))?,
                None if !node.keys.is_empty() => self.refuse(node, place, "which has no fields")?,
                None => {
                    for (range, child) in &node.items {
                        let want = self.settle(ty, Want::Node(child), place)?;
                        if let Some(leaf) = self.scalar(ty, want, place)? {
                            found.push((range.clone(), leaf));
                        }
                    }
                }
            },
        }
        found.sort_by_key(|(range, _)| range.start);
        Ok(found
            .into_iter()
            .map(|(range, leaf)| self.pick(range, &leaf))
            .collect())
    }

    /// Refuses a place whose type does not fit, if anything below is required.
    fn refuse(&self, node: &Node, place: Place<'t>, why: &str) -> Result<(), CompileError> {
        if !node.is_required() {
            return Ok(());
        }
        let Place {
            owner, name, ty, ..
        } = place;
        let described = self.types.describe(ty, place.shape);
        Err(CompileError::Path(match owner {
            Some(owner) => format!("{name:?} of {} is {described}, {why}", owner.name),
            None => format!("the message is {name}, {why}"),
        }))
    }
}

/// The member of this name. The times of ROS 1 also go by the names that Python and ROS 2 have for their members.
fn position(of: &Struct, key: &str) -> Option<usize> {
    let find = |name: &str| of.members.iter().position(|member| member.name == name);
    find(key).or_else(|| match (of.name.as_str(), key) {
        ("time" | "duration", "secs") => find("sec"),
        ("time" | "duration", "nsecs" | "nanosec") => find("nsec"),
        _ => None,
    })
}

fn missing(of: &Struct, key: &str) -> String {
    if of.members.is_empty() {
        return format!("{} has no field {key:?}, it is empty", of.name);
    }
    let names: Vec<&str> = of
        .members
        .iter()
        .take(LISTED_FIELDS)
        .map(|member| member.name.as_str())
        .collect();
    let more = if of.members.len() > LISTED_FIELDS {
        ", .."
    } else {
        ""
    };
    format!(
        "{} has no field {key:?}, its fields are {}{more}",
        of.name,
        names.join(", ")
    )
}

fn values_leaf(target: usize, required: bool) -> Leaf {
    Leaf {
        field: Field::Values(target),
        required,
        template: None,
    }
}

/// Can one value of this type be the field?
fn fits(ty: Type, field: Field) -> bool {
    match (field, ty) {
        (Field::Values(_) | Field::EndFlag, Type::Number(_))
        | (Field::Episode { .. } | Field::Names(_), Type::Text) => true,
        (Field::Reward, Type::Number(number)) => number != Number::Bool,
        (
            Field::Episode { .. } | Field::Step | Field::StampSeconds | Field::StampNanos,
            Type::Number(number),
        ) => number.is_integer(),
        _ => false,
    }
}

fn expected(field: Field) -> &'static str {
    match field {
        Field::Values(_) => "where numbers are expected",
        Field::Names(_) => "where texts are expected",
        Field::Episode { .. } => "where an integer or a text is expected",
        Field::Step | Field::StampSeconds | Field::StampNanos => "where an integer is expected",
        Field::Reward => "where a number is expected",
        Field::EndFlag => "where a flag is expected",
    }
}

impl Node {
    /// A required scalar below. How many values and names there must be is checked elsewhere.
    pub(super) fn required_scalar(&self) -> Option<Field> {
        match &self.leaf {
            Some(leaf) => leaf.is_required_scalar().then_some(leaf.field),
            None => self.children().find_map(Self::required_scalar),
        }
    }

    fn children(&self) -> impl Iterator<Item = &Self> {
        let keys = self.keys.iter().map(|(_, child)| child);
        keys.chain(self.items.iter().map(|(_, child)| child))
    }
}

impl Leaf {
    pub(super) fn is_required_scalar(&self) -> bool {
        self.required && !matches!(self.field, Field::Values(_) | Field::Names(_))
    }
}
