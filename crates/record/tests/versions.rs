//! Files of earlier and of later versions.
#![allow(clippy::unwrap_used, reason = "a test of its own")]

use stridemap_record::files::{read_json, write_json};
use stridemap_record::{Run, Summary};

#[test]
fn an_earlier_summary_is_read_and_one_of_another_format_refused_by_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("summary.json");
    let earlier = include_str!("../../mutate/corpus/run/summary.json");
    std::fs::write(&path, earlier).unwrap();
    let summary: Summary = read_json(&path).unwrap();
    assert_eq!((summary.format, summary.iterations.len()), (1, 2));
    let later = Summary { format: 2, ..summary };
    write_json(&path, &later).unwrap();
    let error = read_json::<Summary>(&path).unwrap_err().to_string();
    let said = "summary.json: has format 2; this version reads format 1";
    assert!(error.ends_with(said), "{error}");
    assert_eq!(Run::read(dir.path()).unwrap().problems, [said]);
}
