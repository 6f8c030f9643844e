//! What Figs. 7 to 10 say, checked in their bytes.

#![allow(clippy::unwrap_used)] // helpers of tests stand outside of #[test]

mod common;

use common::figures::*;
use std::path::{Path, PathBuf};
use stridemap_report::figures::*;
use stridemap_report::{Figure, ReportError};

/// Where the pictures of this test may be looked at.
fn gallery() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery")
}

fn count(figure: &Figure, needle: &str) -> usize {
    figure.svg.matches(needle).count()
}

#[test]
fn fig7_shows_samples_and_both_bands() {
    let figure = fig7(&fig7_data()).unwrap();
    figure.write(&gallery()).unwrap();
    assert!(figure.caption.contains("n = 10 samples"));
    assert_eq!(count(&figure, "<circle"), 10 + 1, "ten samples and the legend's");
    assert_eq!(figure.csv.lines().count(), 1 + 201 + 10);
    assert!(figure.csv.contains("\nsample,0.35,"));
    assert_eq!(count(&figure, "fill-opacity=\"0.12\""), 1);
}

#[test]
fn fig8_marks_the_significant_trials_and_reads_at_both_ends() {
    let figure = fig8(&fig8_data()).unwrap();
    figure.write(&gallery()).unwrap();
    // 0.4 / (1 + t² / 5) < 0.05 from t = 6 on.
    assert!(figure.caption.contains("at trial 6, 7, 8, 9, 10, 11, 12, 13, 14, 15."));
    assert_eq!(count(&figure, ">*<"), 10);
    assert!(figure.caption.contains("n = 5 seeds") && figure.caption.contains("averaged over 20 strides"));
    assert!(figure.caption.contains("GP map −0.00161 ± 0.00073"));
    for tick in [">−0.1<", ">−0.001<", ">0<"] {
        assert!(figure.svg.contains(tick), "{tick}");
    }
    assert!(figure.csv.lines().nth(1).unwrap().ends_with(','), "no p before learning");
}

#[test]
fn fig9_counts_its_rug() {
    let figure = fig9(&fig9_data()).unwrap();
    figure.write(&gallery()).unwrap();
    assert!(figure.caption.contains("GP map above (n = 140)"));
    assert!(figure.svg.contains("<tspan dy=\"3.12\" font-size=\"9.88\">roll</tspan>"));
    assert_eq!(figure.csv.lines().count(), 62);
}

#[test]
fn fig10_gives_slope_and_fixed_point_of_each() {
    let [nominal, learned] = pushed();
    let figure = fig10(&[("nominal gait", &nominal), ("learned policy", &learned)], Some(2.0)).unwrap();
    figure.write(&gallery()).unwrap();
    assert!(figure.caption.contains("nominal gait: slope 0.66, fixed point 3.02 deg (n = 39 pairs, 1 fall)"));
    assert!(figure.caption.contains("learned policy: slope 0.12, fixed point 2.03 deg (n = 39 pairs, no fall)"));
    assert!(figure.caption.contains("fixed point 2.3 deg for a target of 2.0 deg"));
    assert_eq!(figure.csv.lines().count(), 1 + 2 * 39);
    assert_eq!(figure.hover.len(), 2 * 39 + 2);
}

#[test]
fn the_same_data_give_the_same_bytes() {
    let (a, b) = (fig8(&fig8_data()).unwrap(), fig8(&fig8_data()).unwrap());
    assert_eq!(a, b);
    assert_eq!(a.png().unwrap(), b.png().unwrap());
}

#[test]
fn bad_data_are_refused_by_name() {
    let mut data = fig7_data();
    data.std[3] = f64::NAN;
    assert!(matches!(
        fig7(&data),
        Err(ReportError::NotFinite { column, index: 3, .. }) if column == "std"
    ));
    let mut data = fig9_data();
    data.gp.spread.pop();
    assert!(matches!(
        fig9(&data),
        Err(ReportError::Shape { column, found: 60, expected: 61, .. }) if column == "gp.mean"
    ));
    let empty = Fig8 { trials: Vec::new(), seeds: 0, strides: 0 };
    assert!(matches!(fig8(&empty), Err(ReportError::Empty { .. })));
}
