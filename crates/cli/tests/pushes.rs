//! The push atlas: killed and started again, on one thread or two, it comes out the same.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::process::{Command, Stdio};

fn stridemap(dir: &Path, args: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stridemap"));
    command.current_dir(dir).args(args.split(' ')).stdout(Stdio::null());
    command
}

#[test]
fn an_atlas_that_was_killed_goes_on_and_has_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let short = "--set record.strides=4 --set record.iteration_strides=3 --set record.pose_seconds=0";
    assert!(stridemap(dir.path(), &format!("learn stepping --out run {short}")).status().unwrap().success());
    let atlas = "push run --atlas --phases 1 --directions 3 --out";
    assert!(stridemap(dir.path(), &format!("{atlas} whole --threads 1")).status().unwrap().success());
    let mut child = stridemap(dir.path(), &format!("{atlas} killed --threads 1")).spawn().unwrap();
    let part = dir.path().join("killed/push-atlas.part");
    // Its header and two cells.
    let has_two = || std::fs::read_to_string(&part).is_ok_and(|text| text.lines().count() >= 3);
    while !has_two() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was killed");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let again = stridemap(dir.path(), &format!("{atlas} killed --threads 2")).stderr(Stdio::piped()).output().unwrap();
    let said = String::from_utf8_lossy(&again.stderr);
    assert!(again.status.success() && said.contains("of 6 cells are there already"), "{said}");
    assert!(!part.exists());
    for file in ["push-atlas.csv", "push-atlas.json", "figures/push-atlas.svg"] {
        let read = |run: &str| std::fs::read(dir.path().join(run).join(file)).unwrap();
        assert!(read("whole") == read("killed"), "{file}");
    }
    let nobody = stridemap(dir.path(), "push run --atlas --body toe").stderr(Stdio::piped()).output().unwrap();
    let said = String::from_utf8_lossy(&nobody.stderr);
    assert!(nobody.status.code() == Some(2) && said.contains("it has torso"), "{said}");
}
