//! Every row of the fault table is as it must be, on a running link; `-- --nocapture` shows the table.
#![allow(clippy::print_stdout, reason = "a table to look at")]

use stridemap_link::fault_table;
use stridemap_robot::Ros2Config;

#[test]
fn every_fault_is_met() {
    let link = Ros2Config { domain: 100, ..Ros2Config::default() };
    let mut rows = Vec::new();
    fault_table(&link, &mut |row| {
        let within = row.within_ms.map_or("-".into(), |ms| format!("{ms:.0} ms"));
        println!("| {} | {within} | {} |", row.fault, row.seen);
        rows.push(row);
    });
    let bad: Vec<_> = rows.iter().filter(|row| !row.ok).collect();
    assert!(bad.is_empty(), "{bad:#?}");
    assert!(rows.len() >= 19, "{}", rows.len());
}
