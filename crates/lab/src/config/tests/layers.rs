//! `extends`, `--set` and the directories of relative paths.

use std::path::Path;

use super::*;

#[test]
fn child_is_laid_over_its_parent() {
    let parent = "a = [1, 2]\nc = 1\n[t]\nx = 1\ny = 2\n[[s]]\nu = 1\n[[s]]\nu = 2";
    let child = "extends = \"parent\"\na = [3]\n[t]\ny = 5\nz = 6\n[[s]]\nv = 1";
    let tasks = [("parent", parent), ("child", child)];
    let document = Document::load("child", &[], files(&tasks)).unwrap();
    assert_eq!(
        document.to_toml(),
        "a = [3]\nc = 1\n\n[t]\nx = 1\ny = 5\nz = 6\n\n[[s]]\nv = 1\n"
    );
    let place = |key: &str| document.origin_of(key).to_string();
    assert_eq!(place("t.x"), "parent:4");
    assert_eq!(place("t.y"), "child:4");
    assert_eq!(place("t"), "child:3");
    assert_eq!(place("c"), "parent:2");
    let names: Vec<&str> = document.sources().iter().map(|s| &*s.name).collect();
    assert_eq!(names, ["child", "parent"]);
}

#[test]
fn another_kind_keeps_the_other_keys() {
    let parent = "[map]\nkind = \"gp\"\nsamples = 60";
    let other = "extends = \"parent\"\n[map]\nkind = \"linear\"\nridge = 1.0";
    let tasks = [("parent", parent), ("other", other)];
    let text = |name: &str, arguments: &[&str]| {
        Document::load(name, &sets(arguments), files(&tasks))
            .unwrap()
            .to_toml()
    };
    let linear = "[map]\nkind = \"linear\"\nsamples = 60\nridge = 1.0\n";
    assert_eq!(text("other", &[]), linear);
    assert_eq!(
        text("parent", &["map.kind=linear", "map.ridge=1.0"]),
        linear
    );
}

#[test]
fn faults_name_the_layer_they_come_from() {
    let parent = "map = \"exact\"\n[robot]\nfrictoin = 1";
    let child = "extends = \"parent\"\n[robot]\nmirrored = true";
    let tasks = [("parent", parent), ("child", child)];
    let document = Document::load("child", &[], files(&tasks)).unwrap();
    assert!(
        message(document.deserialize::<Task>())
            .starts_with("parent:3: robot.frictoin: unknown key")
    );
    let tasks = [("parent", "map = \"exact\""), ("child", child)];
    let document = Document::load("child", &[], files(&tasks)).unwrap();
    assert_eq!(
        message(document.deserialize::<Task>()),
        "child:2: robot.friction: missing key"
    );
}

#[test]
fn cycles_print_their_chain() {
    let tasks = [
        ("a.toml", "extends = \"b.toml\""),
        ("b.toml", "\nextends = \"c.toml\""),
        ("c.toml", "extends = \"b.toml\""),
    ];
    assert_eq!(
        message(Document::load("a.toml", &[], files(&tasks))),
        "c.toml:1: extends: a task extends itself: a.toml -> b.toml -> c.toml -> b.toml"
    );
    let endless = |_: &str, dir: Option<&Path>| {
        let base_dir = dir.unwrap_or(Path::new("")).join("x");
        Ok(TaskText {
            source_name: "x/a.toml".to_owned(),
            text: "extends = \"x/a.toml\"".to_owned(),
            base_dir: Some(base_dir),
        })
    };
    assert_eq!(
        message(Document::load("x/a.toml", &[], endless)),
        "x/a.toml:1: extends: more than 32 tasks extend one another"
    );
}

#[test]
fn tasks_that_are_not_found() {
    let tasks = [
        ("walking", ""),
        ("typo", "# mine\nextends = \"walkin\""),
        ("number", "extends = 3"),
    ];
    assert_eq!(
        message(Document::load("typo", &[], files(&tasks))),
        "typo:2: extends = \"walkin\": unknown task; did you mean \"walking\"? \
         (built in: walking, typo, number; or the path of a file)"
    );
    assert_eq!(
        message(Document::load("walkin", &[], files(&tasks))),
        "unknown task \"walkin\"; did you mean \"walking\"? \
         (built in: walking, typo, number; or the path of a file)"
    );
    assert_eq!(
        message(Document::load("number", &[], files(&tasks))),
        "number:1: extends: expected the name of a task or a file, found the integer 3"
    );
    let unreadable = |_: &str, _: Option<&Path>| {
        Err(ResolveError::Unreadable {
            name: "mine.toml".to_owned(),
            reason: "permission denied".to_owned(),
        })
    };
    assert_eq!(
        message(Document::load("mine.toml", &[], unreadable)),
        "cannot read mine.toml: permission denied"
    );
}

#[test]
fn sets_reach_everything() {
    let tasks = [("task", GOOD)];
    let arguments = [
        "action.0.bounds=[1, 2]",
        "action.1.modulates = lean_deg",
        "robot.friction=1",
        "robot.rest_deg={ knee = 3.5 }",
        "robot.model=a=b.xml",
        "map.sample=mean",
        "strides=7",
        "\"seed\"=3",
    ];
    let document = Document::load("task", &sets(&arguments), files(&tasks)).unwrap();
    let task: Task = document.deserialize().unwrap();
    let action = |modulates: &str, bounds| Action {
        modulates: modulates.to_owned(),
        bounds,
    };
    assert_eq!(task.action[0], action("walk_amplitude_deg", [1.0, 2.0]));
    assert_eq!(task.action[1], action("lean_deg", [-1.0, 1.0]));
    assert_eq!(
        task.robot.rest_deg,
        BTreeMap::from([(Joint::HipPitch, 15.0), (Joint::Knee, 3.5)])
    );
    assert_eq!(task.robot.model, Some("a=b.xml".into()));
    assert_eq!((task.strides, task.seed), (7, Some(3)));
}

#[test]
fn faults_in_sets() {
    let tasks = [("task", GOOD)];
    let said = |argument: &str| {
        let document = Document::load("task", &sets(&[argument]), files(&tasks));
        message(document.and_then(|document| document.deserialize::<Task>()))
    };
    let cases = [
        (
            "robot.mass_scale=abc",
            "robot.mass_scale: expected a number, found the string \"abc\"",
        ),
        (
            "robot.frictoin=1",
            "robot.frictoin: unknown key; did you mean `friction`? \
             (allowed: friction, mass_scale, model, rest_deg, mirrored)",
        ),
        (
            "robto.friction=1",
            "robto: unknown key; did you mean `robot`? \
             (allowed: robot, map, action, strides, seed)",
        ),
        (
            "robot.friction.x=1",
            "robot.friction: expected a number, found a table",
        ),
        (
            "map.sample=ful",
            "map.sample = \"ful\": unknown value; did you mean \"full\"? \
             (allowed: full, latent, mean)",
        ),
        (
            "action.2.bounds=[0, 1]",
            "action: expected an index from 0 to 1, found \"2\"",
        ),
        (
            "action.bounds=[0, 1]",
            "action: expected an index from 0 to 1, found \"bounds\"",
        ),
        (
            "robot.friction=nan",
            "robot.friction: expected a number, found nan",
        ),
        (
            "action.0.bounds=[1, nan]",
            "action.0.bounds.1: expected a number, found nan",
        ),
        (
            "extends=walking",
            "extends: cannot be set; name the other task instead of this one",
        ),
        ("strides", "not valid TOML: expected KEY=VALUE"),
        ("=3", "not valid TOML: expected a key such as a.b or a.0.b"),
        (
            "a..b=3",
            "not valid TOML: expected a key such as a.b or a.0.b",
        ),
        (
            "action.0.bounds=[0, 1",
            "action.0.bounds: not valid TOML: unclosed array, expected `]`",
        ),
    ];
    for (argument, expected) in cases {
        assert_eq!(said(argument), format!("--set {argument}: {expected}"));
    }
}

#[test]
fn relative_paths_start_where_they_are_written() {
    let tasks = [
        ("parent", "[robot]\nmodel = \"a.xml\"\nskin = \"s.png\""),
        (
            "child",
            "extends = \"parent\"\nrobot.skin = \"t.png\"\nlog = \"l\"",
        ),
    ];
    let arguments = sets(&["log=here"]);
    let document = Document::load("child", &arguments, files(&tasks)).unwrap();
    let dir = |key: &str| document.base_dir_of(key);
    assert_eq!(dir("robot.model"), Some(Path::new("dir-of-parent")));
    assert_eq!(dir("robot.skin"), Some(Path::new("dir-of-child")));
    assert_eq!(dir("log"), Some(Path::new("")));
}

/// The resolver that the command uses, on real files.
#[test]
fn files_extend_files_beside_them() {
    let dir = std::env::temp_dir().join(format!("stridemap-config-{}", std::process::id()));
    std::fs::create_dir_all(dir.join("sub")).unwrap();
    std::fs::write(dir.join("base.toml"), "extends = \"walking\"\na = 1").unwrap();
    std::fs::write(
        dir.join("sub/mine.toml"),
        "extends = \"../base.toml\"\nb = 2",
    )
    .unwrap();
    let built_in = [("walking", "c = 3")];
    let mine = dir.join("sub/mine.toml").display().to_string();
    let document = Document::load(&mine, &[], crate::config::resolver(&built_in));
    let missing = Document::load("none.toml", &[], crate::config::resolver(&built_in));
    std::fs::remove_dir_all(&dir).unwrap();
    let document = document.unwrap();
    assert_eq!(document.to_toml(), "c = 3\na = 1\nb = 2\n");
    assert_eq!(document.base_dir_of("a"), Some(&*dir.join("sub/..")));
    assert_eq!(
        document.origin_of("c").to_string(),
        "built-in task walking:1"
    );
    assert!(message(missing).starts_with("cannot read none.toml: "));
}
