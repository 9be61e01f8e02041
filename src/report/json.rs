//! JSON that may stand inside a page.

use serde::Serialize;

/// `value` as JSON in which no `<` stands as such, so that no text in it can end the element around it.
pub(super) fn embedded(value: &impl Serialize) -> String {
    // Plain data, whose keys are strings: it cannot fail.
    serde_json::to_string(value)
        .unwrap_or_else(|_never| "null".to_owned())
        .replace('<', "\\u003c")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_can_end_the_element_around_it() {
        let hostile = "</script><!--<script>\"'\u{2028}\\";
        let text = embedded(&hostile);
        assert!(!text.contains('<'));
        assert_eq!(serde_json::from_str::<String>(&text).unwrap(), hostile);
    }
}
