//! A figure as dots, with a font of our own: it looks the same on every machine.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

/// The font of the text, cut down to Latin, Greek, Cyrillic and signs; see its folder.
const FONT: &[u8] = include_bytes!("../assets/font/DejaVuSans.ttf");

/// Dots across the figure: 300 an inch.
const WIDTH_DOTS: f32 = 2160.0;

/// `svg` at 300 dots an inch.
pub(super) fn png(svg: &str) -> Result<Vec<u8>, String> {
    let mut options = Options {
        font_family: "DejaVu Sans".to_owned(),
        ..Options::default()
    };
    Arc::make_mut(&mut options.fontdb).load_font_data(FONT.to_vec());
    let tree = Tree::from_str(svg, &options).map_err(|e| e.to_string())?;
    // The size in inches is for print; what is drawn has its own units.
    let size = tree.size();
    let scale = WIDTH_DOTS / size.width();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "lengths of a figure are small and positive"
    )]
    let dots = |length: f32| (length * scale).round() as u32;
    let (width, height) = (dots(size.width()), dots(size.height()));
    let mut pixels = Pixmap::new(width, height)
        .ok_or_else(|| format!("{width} × {height} dots are too many"))?;
    resvg::render(
        &tree,
        Transform::from_scale(scale, scale),
        &mut pixels.as_mut(),
    );
    pixels.encode_png().map_err(|e| e.to_string())
}
