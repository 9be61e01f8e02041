//! Scalable Vector Graphics as text: the few shapes that figures are made of.

use std::fmt::Write as _;

/// A drawing that is being made.
pub(super) struct Svg {
    text: String,
}

const STYLE: &str = "text{font-family:'DejaVu Sans',Helvetica,Arial,sans-serif;fill:#000}\
.title{font-size:11px}.label{font-size:9px}.name{font-size:10px}.tick{font-size:8.5px;fill:#333}.band{font-size:6.5px;fill:#333}";

impl Svg {
    pub(super) fn new(width: f64, height: f64) -> Self {
        let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
        let (inches, high) = (width / 100.0, height / 100.0);
        let _infallible = writeln!(
            text,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{inches}in\" height=\"{high}in\" \
             viewBox=\"0 0 {width} {height}\">\n<style>{STYLE}</style>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>"
        );
        Self { text }
    }

    pub(super) fn finish(mut self) -> String {
        self.text.push_str("</svg>\n");
        self.text
    }

    /// A text in one of the classes of [`STYLE`]; `anchor` is `start`, `middle` or `end`.
    pub(super) fn text(&mut self, x: f64, y: f64, class: &str, anchor: &str, text: &str) {
        let _infallible = writeln!(
            self.text,
            "<text x=\"{x:.2}\" y=\"{y:.2}\" class=\"{class}\" text-anchor=\"{anchor}\">{}</text>",
            escaped(text)
        );
    }

    /// A text that reads from below, centred.
    pub(super) fn upright_text(&mut self, x: f64, y: f64, class: &str, text: &str) {
        let _infallible = writeln!(
            self.text,
            "<text transform=\"translate({x:.2} {y:.2}) rotate(-90)\" class=\"{class}\" text-anchor=\"middle\">{}</text>",
            escaped(text)
        );
    }

    pub(super) fn rect(&mut self, x: f64, y: f64, width: f64, height: f64, colour: &str) {
        let _infallible = writeln!(
            self.text,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" fill=\"{colour}\"/>"
        );
    }

    /// A light background.
    pub(super) fn tint(&mut self, x: f64, y: f64, width: f64, height: f64, colour: &str) {
        let _infallible = writeln!(
            self.text,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" fill=\"{colour}\" fill-opacity=\"0.12\"/>"
        );
    }

    /// An empty box.
    pub(super) fn frame(&mut self, x: f64, y: f64, width: f64, height: f64) {
        let _infallible = writeln!(
            self.text,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" fill=\"none\" stroke=\"#808080\" stroke-width=\"0.6\"/>"
        );
    }

    pub(super) fn rule(&mut self, from: (f64, f64), to: (f64, f64), colour: &str, is_dashed: bool) {
        let dashes = if is_dashed {
            " stroke-dasharray=\"4 3\""
        } else {
            ""
        };
        let _infallible = writeln!(
            self.text,
            "<line x1=\"{:.2}\" y1=\"{:.2}\" x2=\"{:.2}\" y2=\"{:.2}\" stroke=\"{colour}\" stroke-width=\"0.7\"{dashes}/>",
            from.0, from.1, to.0, to.1
        );
    }

    pub(super) fn line(
        &mut self,
        points: impl Iterator<Item = (f64, f64)>,
        colour: &str,
        width: f64,
    ) {
        let mut path = String::new();
        for (i, (x, y)) in points.enumerate() {
            let _infallible = write!(path, "{}{x:.2} {y:.2}", if i == 0 { "M" } else { "L" });
        }
        if path.is_empty() {
            return;
        }
        let _infallible = writeln!(
            self.text,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" stroke-linecap=\"round\"/>"
        );
    }
}

/// Text as XML takes it: no markup, and none of the characters that XML cannot hold.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '&' => escaped.push_str("&amp;"),
            '"' => escaped.push_str("&quot;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_never_markup() {
        assert_eq!(
            escaped("</text><script>\"&\u{0}"),
            "&lt;/text&gt;&lt;script&gt;&quot;&amp;\u{fffd}"
        );
    }
}
