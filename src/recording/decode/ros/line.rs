//! One line of a `.msg` definition.

use super::schema::Shape;

/// A member as it is written.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Line<'t> {
    /// The name of its type, without array and bound.
    pub(super) base: &'t str,
    pub(super) shape: Shape,
    pub(super) field: &'t str,
}

/// The member that a line defines; none in an empty line, a comment, a constant or a heading.
pub(super) fn parse(line: &str) -> Result<Option<Line<'_>>, String> {
    let line = line.trim();
    if line.is_empty() || line.starts_with('#') || line.starts_with("MSG:") {
        return Ok(None);
    }
    if line.starts_with("IDL:") {
        return Err("a type it depends on is defined in IDL, which is not read".to_owned());
    }
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    let (written, rest) = line.split_at(end);
    let rest = rest.trim_start();
    let end = rest
        .find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'))
        .unwrap_or(rest.len());
    let (field, rest) = rest.split_at(end);
    if field.is_empty() {
        let start: String = line.chars().take(60).collect();
        return Err(format!("no field in the line {start:?}"));
    }
    if rest.trim_start().starts_with('=') {
        return Ok(None);
    }
    let (base, shape) = type_of(written).ok_or_else(|| format!("{written:?} is not a type"))?;
    Ok(Some(Line { base, shape, field }))
}

/// Splits `string<=10[<=3]` into the name of the type and the shape.
fn type_of(written: &str) -> Option<(&str, Shape)> {
    let (base, shape) = match written.strip_suffix(']') {
        None => (written, Shape::One),
        Some(open) => {
            let (base, n) = open.rsplit_once('[')?;
            let shape = match n.strip_prefix("<=") {
                Some(bound) => bound.parse::<u64>().ok().map(|_| Shape::Sequence)?,
                None if n.is_empty() => Shape::Sequence,
                None => Shape::Array(n.parse().ok()?),
            };
            (base, shape)
        }
    };
    let base = match base.split_once("<=") {
        Some((text @ ("string" | "wstring"), bound)) => {
            bound.parse::<u64>().ok()?;
            text
        }
        Some(_) => return None,
        None => base,
    };
    let is_name = !base.is_empty()
        && base
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'/');
    is_name.then_some((base, shape))
}
