//! What a user sees, word for word.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use toml::Table;

use super::{ConfigError, Document, to_toml};

/// A configuration with one field of every shape that a task file uses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Task {
    robot: Robot,
    draw: Draw,
    #[serde(default)]
    action: Vec<Action>,
    #[serde(default)]
    strides: u32,
    seed: Option<u64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Robot {
    friction: f64,
    model: Option<String>,
    #[serde(default)]
    rest_deg: BTreeMap<String, f64>,
    #[serde(default)]
    mirrored: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Draw {
    Full,
    Latent,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Action {
    modulates: String,
    bounds: [f64; 2],
}

const GOOD: &str = r#"
strides = 60
draw = "full"

[robot]
friction = 1
rest_deg = { hip = 15, knee = -30.5 }
mirrored = true

[[action]]
modulates = "walk_amplitude_deg"
bounds = [0, 12]

[[action]]
modulates = "phase_rad"
bounds = [
  -1.0,
  1.0,
]
"#;

fn read(text: &str, sets: &[&str]) -> Result<Task, ConfigError> {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Document::load("t", &sets, &[("t", text)])?.deserialize()
}

fn message<T: std::fmt::Debug>(result: Result<T, ConfigError>) -> String {
    let message = result.unwrap_err().to_string();
    message.replace("built-in task t:", "t:")
}

/// The start of a line of the good task; what stands there instead; what is said of it.
const FAULTS: &str = r#"
fri | frictoin = 1 | 6: robot.frictoin: unknown key; did you mean `friction`? (allowed: friction, model, rest_deg, mirrored)
fri | colour = 1 | 6: robot.colour: unknown key (allowed: friction, model, rest_deg, mirrored)
fri | | 5: robot.friction: missing key
fri | friction = "a" | 6: robot.friction: expected a number, found the string "a"
fri | friction = {} | 6: robot.friction: expected a number, found a table
mir | mirrored = 1 | 8: robot.mirrored: expected true or false, found the integer 1
mir | model = 1 | 8: robot.model: expected a string, found the integer 1
mir | model = 2026-01-01 | 8: robot.model: expected a string, number, boolean, array or table, found the date 2026-01-01
mir | friction = 3 | 8: not valid TOML: duplicate key
rest | rest_deg = { "left knee" = true } | 7: robot.rest_deg."left knee": expected a number, found the boolean true
rest | rest_deg = 3 | 7: robot.rest_deg: expected a table, found the integer 3
strides | strides = 60.0 | 2: strides: expected an integer from 0 to 4294967295, found the number 60.0
strides | strides = -1 | 2: strides: expected an integer from 0 to 4294967295, found the integer -1
strides | seed = -1 | 2: seed: expected an integer of at least 0, found the integer -1
strides | seed = 18446744073709551615 | 2: seed: expected an integer of at most 64 bits, found the integer 18446744073709551615
strides | strides = = 3 | 2: not valid TOML: extra `=`, expected nothing
draw | draw = "ful" | 3: draw = "ful": unknown value; did you mean "full"? (allowed: full, latent)
draw | draw = 3 | 3: draw: expected one of full, latent, found the integer 3
draw | robot = [1] | 5: not valid TOML: duplicate key
bounds = [0 | bounds = [0, "x"] | 12: action.0.bounds.1: expected a number, found the string "x"
bounds = [0 | bounds = 12 | 12: action.0.bounds: expected an array of 2 values, found the integer 12
  1.0 | "x" | 18: action.1.bounds.1: expected a number, found the string "x"
  1.0 | | 16: action.1.bounds: expected an array of 2 values, found 1 value
  1.0 | 1, 2 | 16: action.1.bounds: expected an array of 2 values, found 3 values
modulates = "phase | | 14: action.1.modulates: missing key
"#;

#[test]
fn every_fault_names_file_line_and_key() {
    for case in FAULTS.trim_matches('\n').lines() {
        let [line, by, expected] = case.split('|').collect::<Vec<_>>()[..] else { panic!("{case}") };
        let mut lines: Vec<&str> = GOOD.lines().collect();
        let at = lines.iter().position(|l| l.starts_with(line.trim_end()));
        lines[at.unwrap()] = by;
        // Lines are counted in files of every system.
        for end in ["\n", "\r\n"] {
            let said = message(read(&lines.join(end), &[]));
            assert_eq!(said, format!("t:{}", expected.trim()));
        }
    }
    let array = message(read("draw = \"full\"\nrobot = [1]", &[]));
    assert_eq!(array, "t:2: robot: expected a table, found an array");
    assert_eq!(message(read("draw = \"full\"", &[])), "t: robot: missing key");
    let long = GOOD.replace("= 60", &format!("= \"{}\"", "é".repeat(500)));
    let quoted = format!("found a string that begins \"{}\"", "é".repeat(80));
    assert!(message(read(&long, &[])).ends_with(&quoted));
    // Keys of one table that are scattered over the file keep their lines.
    let scattered = "robot.friction = 0.7\n\nrobot.model = 1\ndraw = \"full\"";
    let said = "t:3: robot.model: expected a string, found the integer 1";
    assert_eq!(message(read(scattered, &[])), said);
}

#[test]
fn sets_reach_everything() {
    let sets = [
        "action.0.bounds=[1, 2]",
        "action.1.modulates = lean_deg",
        "robot.rest_deg={ knee = 3.5 }",
        "robot.model=a=b.xml",
        "draw=latent",
        "\"seed\"=3",
    ];
    let mut expected = read(GOOD, &[]).unwrap();
    expected.action[0].bounds = [1.0, 2.0];
    expected.action[1].modulates = "lean_deg".to_owned();
    expected.robot.rest_deg.insert("knee".to_owned(), 3.5);
    expected.robot.model = Some("a=b.xml".to_owned());
    (expected.draw, expected.seed) = (Draw::Latent, Some(3));
    assert_eq!(read(GOOD, &sets), Ok(expected));
    // What may be left out can be unset, what may not cannot.
    assert_eq!(read(GOOD, &["seed=3", "seed=none"]).unwrap().seed, None);
    let said = message(read(GOOD, &["robot.friction=none"]));
    assert_eq!(said, "--set robot.friction=none: robot.friction: expected a number, found the string \"none\"");
}

/// A `--set`, and what is said of it.
const SETS: &str = r#"
robot.friction=abc | robot.friction: expected a number, found the string "abc"
robot.frictoin=1 | robot.frictoin: unknown key; did you mean `friction`? (allowed: friction, model, rest_deg, mirrored)
robto.friction=1 | robto: unknown key; did you mean `robot`? (allowed: robot, draw, action, strides, seed)
robot.friction.x=1 | robot.friction: expected a number, found a table
action.2.bounds=[0, 1] | action: expected an index from 0 to 1, found "2"
action.bounds=[0, 1] | action: expected an index from 0 to 1, found "bounds"
action.0.bounds=[1, true] | action.0.bounds.1: expected a number, found the boolean true
action.0.bounds=[0, 1 | action.0.bounds: not valid TOML: unclosed array, expected `]`
extends=walking | extends: cannot be set; name the other task instead of this one
strides | not valid TOML: expected KEY=VALUE
=3 | not valid TOML: expected a key such as a.b or a.0.b
a..b=3 | not valid TOML: expected a key such as a.b or a.0.b
"#;

#[test]
fn faults_in_sets() {
    for case in SETS.trim().lines() {
        let (set, expected) = case.split_once(" | ").unwrap();
        let said = message(read(GOOD, &[set]));
        assert_eq!(said, format!("--set {set}: {expected}"));
    }
}

#[test]
fn a_file_is_laid_over_those_it_extends_and_faults_name_theirs() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("sub")).unwrap();
    let file = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let base = "extends = \"stepping\"\n[robot]\nmodel = \"a.xml\"\nfriction = 0.5\n\n[[action]]\nmodulates = \"x\"\nbounds = [0, 1]";
    file("base.toml", base);
    let mine = "extends = \"../base.toml\"\nstrides = 3\n[robot]\nfriction = 0.1";
    let mine = file("sub/mine.toml", mine);
    let built_in = [("stepping", GOOD)];
    let document = Document::load_file(&mine, &["robot.model=b.xml".into()], &built_in).unwrap();
    let task: Task = document.deserialize().unwrap();
    assert_eq!((task.strides, task.robot.friction, task.action.len()), (3, 0.1, 1));
    assert_eq!(document.file(), Some(&*mine));
    assert_eq!(document.base_dir("robot.model"), Some(Path::new("")));
    assert_eq!(document.base_dir("strides"), mine.parent());
    assert_eq!(document.base_dir("draw"), None);
    let said = |key: &str| {
        let text = document.located(key, "bad").to_string();
        text.replace(&format!("{}/", dir.path().display()), "")
    };
    assert_eq!(said("robot.friction"), "sub/mine.toml:4: robot.friction: bad");
    assert_eq!(said("robot.left.knee"), "sub/mine.toml:3: robot.left.knee: bad");
    assert_eq!(said("action.0.bounds.1"), "sub/../base.toml:8: action.0.bounds.1: bad");
    assert_eq!(said("action.7.bounds"), "sub/../base.toml:6: action.7.bounds: bad");
    assert_eq!(said("draw"), "built-in task stepping:3: draw: bad");
    assert_eq!(said("gait.phase"), "sub/mine.toml: gait.phase: bad");
    assert_eq!(document.keys("robot.rest_deg"), Some(vec!["hip", "knee"]));
    assert_eq!(document.keys("strides"), None);

    let load = |name: &str| {
        let tasks = [
            ("walking", ""),
            ("typo", "# mine\nextends = \"walkin\""),
            ("number", "extends = 3"),
            ("a", "extends = \"b\""),
            ("b", "\nextends = \"a\""),
        ];
        message(Document::load(name, &[], &tasks)).replace(&*dir.path().to_string_lossy(), "DIR")
    };
    let known = "did you mean \"walking\"? (built in: walking, typo, number, a, b; or the path of a file)";
    assert_eq!(load("walkin"), format!("unknown task \"walkin\"; {known}"));
    let typo = format!("built-in task typo:2: extends = \"walkin\": unknown task; {known}");
    assert_eq!(load("typo"), typo);
    assert_eq!(
        load("number"),
        "built-in task number:1: extends: expected the name of a task or a file, found the integer 3"
    );
    assert_eq!(
        load("a"),
        "built-in task b:2: extends: a task extends itself: \
         built-in task a -> built-in task b -> built-in task a"
    );
    std::fs::write(dir.path().join("latin.toml"), b"a = 1\nb = \"\xff\"").unwrap();
    let latin = dir.path().join("latin.toml");
    assert_eq!(load(latin.to_str().unwrap()), "cannot read DIR/latin.toml:2: is not text (UTF-8)");
    assert!(load("none.toml").starts_with("cannot read none.toml: "));
}

#[test]
fn every_value_is_written_as_a_user_writes_it_and_reads_back() {
    let task = read(GOOD, &["robot.friction=1e-9"]).unwrap();
    let text = to_toml(&task).unwrap();
    assert_eq!(
        text,
        "draw = \"full\"\nstrides = 60\n\n\
         [robot]\nfriction = 1e-9\nmirrored = true\n\n\
         [robot.rest_deg]\nhip = 15.0\nknee = -30.5\n\n\
         [[action]]\nmodulates = \"walk_amplitude_deg\"\nbounds = [0.0, 12.0]\n\n\
         [[action]]\nmodulates = \"phase_rad\"\nbounds = [-1.0, 1.0]\n"
    );
    assert_eq!(read(&text, &[]), Ok(task));
    let awkward = "\"\" = 1\n\"a.b\" = \"\\u0001\\\"\\\\\\u007f\"\n'quo\"te' = '''\nline\r\n'''\n\
                   nested = [[{ \"a b\" = [] }, 1], [], {}]\nempty = {}\n[[t]]\n[[t]]\nx.y = -0.0";
    let table: Table = awkward.parse().unwrap();
    let written = to_toml(&table).unwrap();
    assert_eq!(written.parse::<Table>().unwrap(), table, "{written}");
}

/// Recursion ends before the stack does, and a table of many keys is read in time that grows with them.
#[test]
fn deep_and_wide_texts() {
    for depth in [65, 100, 100_000] {
        let dotted = vec!["a"; depth].join(".");
        let brackets = format!("{}{}", "[".repeat(depth), "]".repeat(depth));
        for text in [
            format!("x = {brackets}"),
            format!("x = {}1{}", "{a=".repeat(depth), "}".repeat(depth)),
            format!("x.{dotted} = 1"),
            format!("[x.{dotted}]"),
            format!("x = {}1{}", "{a.b.c=".repeat(depth / 2), "}".repeat(depth / 2)),
        ] {
            assert!(message(read(&text, &[])).starts_with("t:1: not valid TOML: "));
        }
        let set = format!("x.{dotted}=1");
        assert!(message(read("", &[&set])).starts_with(&format!("--set {set}: ")));
    }
    let keys: String = (0..100_000).map(|i| format!("k{i} = 1\n")).collect();
    let wide = format!("{GOOD}[robot.rest_deg]\n{keys}").replace("rest_deg = {", "# {");
    let tasks = [("t", wide.as_str()), ("child", &format!("extends = \"t\"\n[robot.rest_deg]\n{keys}"))];
    let task: Task = Document::load("child", &[], &tasks).unwrap().deserialize().unwrap();
    assert_eq!(task.robot.rest_deg.len(), 100_000);
}
