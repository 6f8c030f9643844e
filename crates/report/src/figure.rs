//! A finished figure and its three files.

use std::fs;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use crate::draw::{REGULAR, SEMI_BOLD};
use crate::error::{ReportError, Result};
use resvg::{tiny_skia, usvg};

/// Pixels of the PNG per pixel of the SVG.
const PNG_SCALE: f32 = 2.5;

/// A datum that the page shows when the pointer or the keyboard comes to it.
#[derive(Clone, Debug, PartialEq)]
pub struct HoverPoint {
    /// Column in the figure's own pixels.
    pub x: f64,
    /// Row in the figure's own pixels, downward.
    pub y: f64,
    /// What to show: names, values and units.
    pub text: String,
}

/// A picture with everything that a reader of it needs.
///
/// The same data give the same bytes of `svg`, `csv` and PNG.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// File name without extension.
    pub stem: String,
    /// One line above the picture.
    pub title: String,
    /// What is plotted, units, `n`, how the spread is measured, and the paper's number if it has one.
    pub caption: String,
    /// The picture in words, for who cannot see it.
    pub alt: String,
    /// The picture with its caption, self-contained, light and dark.
    pub svg: String,
    /// The data drawn, one table, header first.
    pub csv: String,
    /// The picture without caption and style, for a page that brings both.
    pub inline_svg: String,
    /// Values under the pointer.
    pub hover: Vec<HoverPoint>,
}

impl Figure {
    /// Writes `stem.svg`, `stem.png` and `stem.csv` into a directory, which is made if need be.
    ///
    /// Each file is written aside and renamed, so that a reader sees the old bytes or the new ones.
    ///
    /// # Errors
    ///
    /// [`ReportError::Io`] if a file cannot be written, [`ReportError::Raster`] if the SVG cannot be
    /// turned into pixels.
    pub fn write(&self, dir: &Path) -> Result<()> {
        fs::create_dir_all(dir).map_err(|source| ReportError::Io { path: dir.to_owned(), source })?;
        let png = self.png()?;
        write_aside(&dir.join(format!("{}.svg", self.stem)), self.svg.as_bytes())?;
        write_aside(&dir.join(format!("{}.png", self.stem)), &png)?;
        write_aside(&dir.join(format!("{}.csv", self.stem)), self.csv.as_bytes())
    }

    /// The SVG rasterised with the bundled font, 2.5 pixels to one.
    ///
    /// # Errors
    ///
    /// [`ReportError::Raster`] if the SVG cannot be read or is empty.
    pub fn png(&self) -> Result<Vec<u8>> {
        let fail = |what: String| ReportError::Raster { figure: self.stem.clone(), what };
        let options = usvg::Options { fontdb: fonts(), font_family: "Inter".to_owned(), ..usvg::Options::default() };
        let tree = usvg::Tree::from_str(&self.svg, &options).map_err(|e| fail(e.to_string()))?;
        let size = tree.size();
        let (width, height) = (size.width() * PNG_SCALE, size.height() * PNG_SCALE);
        let mut pixels = tiny_skia::Pixmap::new(width.ceil() as u32, height.ceil() as u32)
            .ok_or_else(|| fail(format!("a picture of {width} by {height} pixels")))?;
        let transform = tiny_skia::Transform::from_scale(PNG_SCALE, PNG_SCALE);
        resvg::render(&tree, transform, &mut pixels.as_mut());
        pixels.encode_png().map_err(|e| fail(e.to_string()))
    }
}

fn fonts() -> Arc<usvg::fontdb::Database> {
    static FONTS: OnceLock<Arc<usvg::fontdb::Database>> = OnceLock::new();
    Arc::clone(FONTS.get_or_init(|| {
        let mut database = usvg::fontdb::Database::new();
        database.load_font_data(REGULAR.to_vec());
        database.load_font_data(SEMI_BOLD.to_vec());
        database.set_sans_serif_family("Inter");
        Arc::new(database)
    }))
}

/// Writes a whole file, as [`stridemap_files::write_whole`] does.
///
/// # Errors
///
/// [`ReportError::Io`] naming the file.
pub fn write_aside(path: &Path, bytes: &[u8]) -> Result<()> {
    stridemap_files::write_whole(path, bytes).map_err(|source| ReportError::Io { path: path.to_owned(), source })
}
