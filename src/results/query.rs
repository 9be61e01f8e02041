//! Which episodes a user means.

use crate::model::EpisodeKey;

/// Episodes by what a user types: `RECORDING:EPISODE`, a recording, or an episode's id in any recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpisodeQuery(String);

impl EpisodeQuery {
    /// Takes any text; it may match nothing.
    pub fn new(text: &str) -> Self {
        Self(text.to_owned())
    }

    /// As it was typed.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Is an episode meant?
    pub fn matches(&self, key: &EpisodeKey) -> bool {
        let is_id =
            |text: &str| key.episode_id.as_deref() == Some(text) || key.episode.to_string() == text;
        let rest = self.0.strip_prefix(&*key.recording);
        rest == Some("")
            || rest.and_then(|r| r.strip_prefix(':')).is_some_and(is_id)
            || is_id(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_episode_is_meant_by_its_name_its_recording_or_its_id() {
        let key = EpisodeKey {
            recording: "a/b:c.mcap".into(),
            episode: 3,
            episode_id: Some("third".into()),
        };
        for (text, expected) in [
            ("a/b:c.mcap:3", true),
            ("a/b:c.mcap:third", true),
            ("a/b:c.mcap", true),
            ("3", true),
            ("third", true),
            ("a/b", false),
            ("a/b:c.mcap:4", false),
            ("a/b:c.mcap:", false),
            ("", false),
        ] {
            assert_eq!(EpisodeQuery::new(text).matches(&key), expected, "{text:?}");
        }
    }
}
