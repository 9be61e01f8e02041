//! `TOPIC:PATH`: which numbers of which messages are wanted.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;

/// Numbers of the messages of one topic, such as `/joint_states:position[shoulder_pan]`.
///
/// ```
/// use coact::recording::Selector;
/// let selector: Selector = "/command:points[0].positions[2..5]".parse().unwrap();
/// assert_eq!(selector.topic(), "/command");
/// assert_eq!(selector.to_string(), "/command:points[0].positions[2..5]");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Selector {
    topic: String,
    path: Vec<PathPart>,
}

/// One step of a selector's path.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum PathPart {
    /// A member: `.name`, or `["name.with.dots"]`.
    Key(String),
    /// An element: `[3]`.
    Index(usize),
    /// Elements, half-open: `[3..6]`.
    Items { start: usize, end: usize },
    /// The element that the message calls so: `[shoulder_pan]`.
    Name(String),
}

/// Why a text is no selector.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
#[error("{text:?} is not a selector (TOPIC:PATH, such as /joint_states:position): {what}")]
pub struct SelectorError {
    text: String,
    what: &'static str,
}

/// Longest selector that is looked at, bytes.
const MAX_LEN: usize = 4096;

impl Selector {
    pub(crate) fn new(topic: &str, path: Vec<PathPart>) -> Self {
        Self {
            topic: topic.to_owned(),
            path,
        }
    }

    /// A member of the messages of a topic.
    pub(crate) fn of_key(topic: &str, key: &str) -> Self {
        Self::new(topic, vec![PathPart::Key(key.to_owned())])
    }

    /// The topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    pub(crate) fn path(&self) -> &[PathPart] {
        &self.path
    }
}

impl FromStr for Selector {
    type Err = SelectorError;

    fn from_str(text: &str) -> Result<Self, SelectorError> {
        let error = |what| SelectorError {
            text: text.chars().take(80).collect(),
            what,
        };
        if text.len() > MAX_LEN {
            return Err(error("it is too long"));
        }
        let selector = Self::parse(text).map_err(error)?;
        // A topic with brackets may look like another topic with a path: then no text stands for the selector.
        if selector.topic.contains('[')
            && Self::parse(&selector.to_string()).as_ref() != Ok(&selector)
        {
            return Err(error(
                "with brackets in the topic it can be read in two ways",
            ));
        }
        Ok(selector)
    }
}

impl Selector {
    fn parse(text: &str) -> Result<Self, &'static str> {
        let (topic, path) = split(text)?;
        if topic.is_empty() {
            return Err("the topic is empty");
        }
        Ok(Self::new(topic, path))
    }
}

/// Takes topic and path apart. A name in brackets may hold any character, the colon too, so it is the last colon before
/// the first bracket that counts, unless that leaves no path: then the topic has brackets itself.
fn split(text: &str) -> Result<(&str, Vec<PathPart>), &'static str> {
    let outside = text.find('[').unwrap_or(text.len());
    let at = |colon: usize| Ok((&text[..colon], parse_path(&text[colon + 1..])?));
    let result = match text[..outside].rfind(':') {
        Some(colon) => at(colon),
        None if outside < text.len() => Err("there is no colon behind the topic"),
        None => Ok((text, Vec::new())),
    };
    result.or_else(|e| {
        let behind = text.rmatch_indices(':').take_while(|(i, _)| *i > outside);
        behind
            .map(|(i, _)| at(i))
            .find(Result::is_ok)
            .unwrap_or(Err(e))
    })
}

/// A member's name that a path takes only in quotes.
pub(crate) fn needs_quotes(key: &str) -> bool {
    key.is_empty() || key.contains(['.', '[', ']', ':'])
}

fn parse_path(mut rest: &str) -> Result<Vec<PathPart>, &'static str> {
    let mut path = Vec::new();
    while !rest.is_empty() {
        if let Some(inside) = rest.strip_prefix('[') {
            let (part, after) = parse_bracket(inside)?;
            path.push(part);
            rest = after;
            continue;
        }
        let key = match rest.strip_prefix('.') {
            Some(_) if path.is_empty() => return Err("the path begins with a dot"),
            Some(key) => key,
            None if path.is_empty() => rest,
            None => return Err("a dot or a bracket is expected behind a bracket"),
        };
        let end = key.find(['.', '[']).unwrap_or(key.len());
        if end == 0 {
            return Err("a name is empty");
        }
        if key[..end].contains(']') {
            return Err("a bracket is closed that was not opened");
        }
        path.push(PathPart::Key(key[..end].to_owned()));
        rest = &key[end..];
    }
    Ok(path)
}

/// What stands in brackets, and what comes behind them.
fn parse_bracket(inside: &str) -> Result<(PathPart, &str), &'static str> {
    if let Some(quoted) = inside.strip_prefix('"') {
        let (key, after) = quoted
            .split_once("\"]")
            .ok_or("a quoted name does not end with \"]")?;
        return Ok((PathPart::Key(key.to_owned()), after));
    }
    let (text, after) = inside.split_once(']').ok_or("a bracket is not closed")?;
    let text = text.trim();
    if text.is_empty() {
        return Err("a bracket is empty");
    }
    let is_number = |t: &str| !t.is_empty() && t.bytes().all(|b| b.is_ascii_digit());
    let number = |t: &str| t.parse::<usize>().or(Err("an index is too large"));
    let part = match text.split_once("..") {
        Some((start, end)) if is_number(start) && is_number(end) => {
            let Range { start, end } = number(start)?..number(end)?;
            if start >= end {
                return Err("a range is empty");
            }
            PathPart::Items { start, end }
        }
        _ if is_number(text) => match number(text)? {
            usize::MAX => return Err("an index is too large"),
            index => PathPart::Index(index),
        },
        _ if text.starts_with('"') => return Err("a quoted name does not end with \"]"),
        _ => PathPart::Name(text.to_owned()),
    };
    Ok((part, after))
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.topic)?;
        for (i, part) in self.path.iter().enumerate() {
            match part {
                PathPart::Key(key) if needs_quotes(key) => write!(f, "[\"{key}\"]")?,
                PathPart::Key(key) if i == 0 => f.write_str(key)?,
                PathPart::Key(key) => write!(f, ".{key}")?,
                PathPart::Index(index) => write!(f, "[{index}]")?,
                PathPart::Items { start, end } => write!(f, "[{start}..{end}]")?,
                PathPart::Name(name) => write!(f, "[{name}]")?,
            }
        }
        Ok(())
    }
}

impl Serialize for Selector {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Selector {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?
            .parse()
            .map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selectors_come_back_as_they_were_typed() {
        for text in [
            "/step:action",
            "/joint_states:position[shoulder_pan]",
            "/command:points[0].positions",
            "/odd:[\"a:b\"].c",
            "/t:a.b.c[3..6]",
            "/t:[2]",
            "/t:[\"a.b\"].c",
            "a:b:c",
            "/t:x[a:b]",
            "/t:[\"a:b\"]",
            "/t [0]:a[b:c]",
            "a:b [0]:c[1]",
            "/t:a[\"x:y\"][3]",
        ] {
            let selector: Selector = text.parse().unwrap();
            assert_eq!(selector.to_string(), text);
        }
        assert_eq!(
            "a:b:c".parse::<Selector>().unwrap().topic(),
            "a:b",
            "the last colon counts"
        );
        assert_eq!("a:b [0]:c".parse::<Selector>().unwrap().topic(), "a:b [0]");
        assert_eq!("/ram".parse::<Selector>().unwrap().to_string(), "/ram:");
    }

    #[test]
    fn a_selector_that_is_printed_is_the_same_once_read_again() {
        let find = "a:b[\"x\u{1c}\0q\"].y]\"z:b[\"x\u{1c}\0q\"].y]\"z[3][3]";
        // The topic of the last one ends behind a bracket that a quoted colon would close.
        let two_ways = ".:s = [\"\nj.:2\n.s.t[\":\"].e";
        for text in [find, "a:b[\"x:/\"][3]", "/t:a:b]c[1]:d", two_ways] {
            if let Ok(selector) = text.parse::<Selector>() {
                assert_eq!(selector.to_string().parse(), Ok(selector), "{text}");
            }
        }
    }

    #[test]
    fn what_is_no_selector_is_refused_with_a_reason() {
        for (text, word) in [
            ("", "topic is empty"),
            (":a", "topic is empty"),
            ("/t:a..b", "name is empty"),
            ("/t:.a", "begins with a dot"),
            ("/t:a[", "not closed"),
            ("/t:a[]", "bracket is empty"),
            ("/t:a[5..5]", "range is empty"),
            ("/t:a[1]b", "is expected behind a bracket"),
            ("/t:a[99999999999999999999999]", "too large"),
            ("/t[0]", "no colon"),
            ("/t:a]", "was not opened"),
            ("/t:a[ \"x]", "quoted name"),
        ] {
            let error = text.parse::<Selector>().unwrap_err().to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
