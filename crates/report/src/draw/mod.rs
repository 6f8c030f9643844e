//! The house style: axes, marks, legend and caption, written as SVG.
//!
//! Why not a plotting library: the figures stand in the source of a page that has a light and a dark
//! theme, shows values on hover and scales to a phone. That needs CSS classes instead of fixed
//! colours, true dashes and clip paths, subscripts in labels, and the pixel position of every datum;
//! plotters, the well-kept choice in Rust, flattens all of these into coloured integer coordinates.
//! What is hard, shaping text and rasterising, is left to `resvg`.

mod axis;
mod contour;
mod panel;
mod sheet;
mod style;
mod text;

pub(crate) use axis::{Axis, Scale, extent};
pub(crate) use contour::contour_lines;
pub(crate) use panel::{
    Anchor, Dash, Key, Mark, Panel, cell_look, line_svg, mark_svg, numbered, pairs, path_data, rect_svg, text_svg,
};
pub(crate) use sheet::Sheet;
pub(crate) use style::{page_variables, ramp_color};
pub(crate) use text::{N, REGULAR, SEMI_BOLD, coord, escape, number, plain, plural, signed, times, width};
