//! The parameters of a run, as its directory has them.

use std::collections::BTreeMap;
use std::str::FromStr;

/// In front of each name in the metadata of files.
const PREFIX: &str = "coact.";

/// The parameters of a run, by the names of their options (`measure`, `threshold`, …).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Parameters(BTreeMap<String, String>);

impl Parameters {
    pub(super) fn new(metadata: &BTreeMap<String, String>) -> Self {
        let without_prefix = |(key, value): (&String, &String)| {
            let key = key.strip_prefix(PREFIX).unwrap_or(key);
            (key.to_owned(), value.clone())
        };
        Self(metadata.iter().map(without_prefix).collect())
    }

    /// One of them, as text.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// All of them, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(k, v)| (k.as_str(), v.as_str()))
    }

    /// λ, the threshold on changes.
    pub fn threshold(&self) -> Option<f64> {
        self.parsed("threshold")
    }

    /// w, the window in steps.
    pub fn window(&self) -> Option<usize> {
        self.parsed("window")
    }

    /// Are the joints cut as one?
    pub fn is_together(&self) -> bool {
        self.get("joints") == Some("together")
    }

    fn parsed<T: FromStr>(&self, name: &str) -> Option<T> {
        self.get(name)?.parse().ok()
    }
}
