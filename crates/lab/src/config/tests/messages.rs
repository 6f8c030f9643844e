//! Every kind of fault with its exact text.

use super::*;
use crate::config::Problem;

#[test]
fn good_task_is_read() {
    let task: Task = Document::parse("my-robot.toml", GOOD)
        .unwrap()
        .deserialize()
        .unwrap();
    assert_eq!(task.strides, 60);
    let action = Action {
        modulates: "phase_rad".to_owned(),
        bounds: [-1.0, 1.0],
    };
    assert_eq!(task.action[1], action);
    assert_eq!(
        task.robot.rest_deg,
        BTreeMap::from([(Joint::HipPitch, 15.0), (Joint::Knee, -30.5)])
    );
    let map = Map::Gp {
        sample: Sample::Latent,
        samples: 60,
    };
    assert_eq!(task.map, map);
}

#[test]
fn every_fault_names_file_line_and_key() {
    let cases = [
        (
            "friction",
            "frictoin = 0.7",
            "5: robot.frictoin: unknown key; did you mean `friction`? \
             (allowed: friction, mass_scale, model, rest_deg, mirrored)",
        ),
        (
            "friction",
            "colour = 0.7",
            "5: robot.colour: unknown key \
             (allowed: friction, mass_scale, model, rest_deg, mirrored)",
        ),
        ("friction", "", "4: robot.friction: missing key"),
        (
            "friction",
            "friction = \"abc\"",
            "5: robot.friction: expected a number, found the string \"abc\"",
        ),
        (
            "friction",
            "friction = {}",
            "5: robot.friction: expected a number, found a table",
        ),
        (
            "friction",
            "friction = 9007199254740993",
            "5: robot.friction: expected an integer of at most 2^53 in size, or a number with a \
             point, found the integer 9007199254740993",
        ),
        (
            "friction",
            "friction = nan",
            "5: robot.friction: expected a number, found nan",
        ),
        (
            "friction",
            "friction = 1e999",
            "5: robot.friction: expected a number below 1.8e308 in size, found the number \
             1e999",
        ),
        (
            "friction",
            "friction = 2026-01-01",
            "5: robot.friction: expected a string, number, boolean, array or table, found the \
             date 2026-01-01",
        ),
        (
            "mass_scale",
            "mirrored = 1",
            "6: robot.mirrored: expected true or false, found the integer 1",
        ),
        (
            "mass_scale",
            "model = 1",
            "6: robot.model: expected a string, found the integer 1",
        ),
        (
            "rest_deg",
            "rest_deg = { hip_pich = 15 }",
            "7: robot.rest_deg.hip_pich: unknown key; did you mean `hip_pitch`? \
             (allowed: hip_pitch, knee)",
        ),
        (
            "rest_deg",
            "rest_deg = { knee = true }",
            "7: robot.rest_deg.knee: expected a number, found the boolean true",
        ),
        (
            "rest_deg",
            "rest_deg = 3",
            "7: robot.rest_deg: expected a table, found the integer 3",
        ),
        (
            "strides",
            "strides = 60.0",
            "2: strides: expected an integer from 0 to 4294967295, found the number 60.0",
        ),
        (
            "strides",
            "strides = -1",
            "2: strides: expected an integer from 0 to 4294967295, found the integer -1",
        ),
        (
            "strides",
            "seed = -1",
            "2: seed: expected an integer of at least 0, found the integer -1",
        ),
        (
            "strides",
            "seed = 18446744073709551615",
            "2: seed: expected an integer of at most 64 bits, found the integer \
             18446744073709551615",
        ),
        (
            "sample ",
            "sample = \"ful\"",
            "11: map.sample = \"ful\": unknown value; did you mean \"full\"? \
             (allowed: full, latent, mean)",
        ),
        (
            "sample ",
            "sample = 3",
            "11: map.sample: expected one of full, latent, mean, found the integer 3",
        ),
        (
            "samples",
            "samples = 256",
            "12: map.samples: expected an integer from 0 to 255, found the integer 256",
        ),
        (
            "samples",
            "sampels = 6",
            "12: map.sampels: unknown key; did you mean `samples`? \
             (allowed: kind, sample, samples)",
        ),
        ("samples", "", "9: map.samples: missing key"),
        (
            "kind",
            "kind = \"pg\"",
            "10: map.kind = \"pg\": unknown value; did you mean \"gp\"? \
             (allowed: gp, linear, scaled, pair, exact)",
        ),
        (
            "kind",
            "kind = 1",
            "10: map.kind: expected a string, found the integer 1",
        ),
        (
            "kind",
            "",
            "9: map.kind: missing key (allowed: gp, linear, scaled, pair, exact)",
        ),
        (
            "kind",
            "kind = \"exact\"",
            "11: map.sample: unknown key (allowed: kind)",
        ),
        (
            "kind",
            "kind = \"linear\"",
            "11: map.sample: unknown key (allowed: kind, ridge)",
        ),
        (
            "bounds",
            "bounds = [0, \"x\"]",
            "16: action.0.bounds.1: expected a number, found the string \"x\"",
        ),
        (
            "bounds",
            "bounds = [0]",
            "16: action.0.bounds: expected an array of 2 values, found 1 value",
        ),
        (
            "bounds",
            "bounds = 12",
            "16: action.0.bounds: expected an array of 2 values, found the integer 12",
        ),
        ("bounds = [-1", "", "18: action.1.bounds: missing key"),
        (
            "strides",
            "strides = = 3",
            "2: not valid TOML: extra `=`, expected nothing",
        ),
        (
            "mass_scale",
            "friction = 3",
            "6: not valid TOML: duplicate key",
        ),
    ];
    for (line, by, expected) in cases {
        assert_eq!(message(with(line, by)), format!("my-robot.toml:{expected}"));
    }
}

#[test]
fn missing_table_is_missing_from_the_file() {
    let result = Document::parse("a.toml", "map = \"exact\"")
        .unwrap()
        .deserialize::<Task>();
    assert_eq!(message(result), "a.toml: robot: missing key");
}

#[test]
fn infinity_is_a_number_when_it_is_written() {
    let task = with("friction", "friction = inf").unwrap();
    assert!(task.robot.friction.is_infinite());
}

#[test]
fn lines_are_counted_in_files_of_every_system() {
    let windows = GOOD.replace('\n', "\r\n").replace("friction", "frictoin");
    let result = Document::parse("a.toml", &windows)
        .unwrap()
        .deserialize::<Task>();
    assert!(message(result).starts_with("a.toml:5: robot.frictoin: unknown key"));
}

/// Keys of one table are scattered over the file: each keeps its own line.
#[test]
fn dotted_keys_and_scattered_tables_keep_their_lines() {
    let text = "robot.friction = 0.7\n\nrobot.model = 1\nmap = \"exact\"";
    let result = Document::parse("a.toml", text)
        .unwrap()
        .deserialize::<Task>();
    assert_eq!(
        message(result),
        "a.toml:3: robot.model: expected a string, found the integer 1"
    );
}

#[test]
fn errors_of_other_modules_are_located() {
    let document = Document::parse("a.toml", GOOD).unwrap();
    let said = |key: &str| document.located(key, "too far").to_string();
    assert_eq!(
        said("action.1.bounds.0"),
        "a.toml:20: action.1.bounds.0: too far"
    );
    assert_eq!(
        said("action.7.bounds"),
        "a.toml:14: action.7.bounds: too far"
    );
    assert_eq!(
        said("robot.left.knee"),
        "a.toml:4: robot.left.knee: too far"
    );
    assert_eq!(said("gait.phase"), "a.toml: gait.phase: too far");
    assert_eq!(said(""), "a.toml: too far");
}

/// Conversions such as `try_from` report through `custom`: the place is that of the value.
#[test]
fn a_refused_conversion_is_located() {
    #[derive(Debug, Deserialize)]
    struct Gait {
        #[allow(dead_code, reason = "only its reading is tested")]
        period_s: Positive,
    }
    #[derive(Debug, Deserialize)]
    #[serde(try_from = "f64")]
    struct Positive;
    impl TryFrom<f64> for Positive {
        type Error = String;
        fn try_from(value: f64) -> Result<Self, String> {
            if value > 0.0 {
                Ok(Self)
            } else {
                Err(format!("must be positive, is {value}"))
            }
        }
    }
    let result = Document::parse("a.toml", "\nperiod_s = -1")
        .unwrap()
        .deserialize::<Gait>();
    assert_eq!(
        message(result),
        "a.toml:2: period_s: must be positive, is -1"
    );
}

/// Serde's own tagged enums lose positions; the place is found again where it is in no doubt.
#[test]
fn serdes_tagged_enums_name_the_key_if_only_one_fits_and_the_table_otherwise() {
    #[derive(Debug, Deserialize)]
    #[allow(dead_code, reason = "only its reading is tested")]
    struct Holder {
        map: Tagged,
    }
    #[derive(Debug, Deserialize)]
    #[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
    #[allow(dead_code, reason = "only its reading is tested")]
    enum Tagged {
        Gp { samples: u32, ridge: f64 },
    }
    let said = |text: &str| {
        message(
            Document::parse("a.toml", text)
                .unwrap()
                .deserialize::<Holder>(),
        )
    };
    assert_eq!(
        said("[map]\nkind = \"gp\"\nsamples = 1\nrigde = 2.0"),
        "a.toml:4: map.rigde: unknown key; did you mean `ridge`? (allowed: samples, ridge)"
    );
    assert_eq!(
        said("[map]\nkind = \"gp\"\nsamples = \"a\"\nridge = 2.0"),
        "a.toml:3: map.samples: expected an integer of at least 0, found the string \"a\""
    );
    assert_eq!(
        said("[map]\nkind = \"gp\"\nsamples = 1.5\nridge = 1.5"),
        "a.toml:1: map: expected an integer of at least 0, found the number 1.5"
    );
    assert_eq!(
        said("[map]\nkind = \"pg\"\nsamples = 1"),
        "a.toml:2: map.kind = \"pg\": unknown value; did you mean \"gp\"? (allowed: gp)"
    );
    assert_eq!(
        said("[map]\nkind = \"gp\"\nsamples = 1"),
        "a.toml:1: map.ridge: missing key"
    );
}

#[test]
fn problems_can_be_matched() {
    let error = with("friction", "frictoin = 1").unwrap_err();
    assert_eq!(error.key_path().segments(), ["robot", "frictoin"]);
    let Problem::UnknownKey { nearest, allowed } = error.problem() else {
        panic!("{error:?}");
    };
    assert_eq!(nearest.as_deref(), Some("friction"));
    assert_eq!(allowed.len(), 5);
}

/// Other names of a field are allowed, and listed; the key is that of the file.
#[test]
fn shapes_beyond_those_of_the_task() {
    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(default)]
    struct Shapes {
        #[serde(alias = "colour")]
        color: char,
        pair: (u8, Option<String>),
        by_joint: BTreeMap<u8, Vec<Map>>,
        narrow: f32,
        wide: i8,
    }
    impl Default for Shapes {
        fn default() -> Self {
            Self {
                color: 'k',
                pair: (0, None),
                by_joint: BTreeMap::new(),
                narrow: 0.0,
                wide: 0,
            }
        }
    }
    let read = |text: &str| {
        Document::parse("a.toml", text)
            .unwrap()
            .deserialize::<Shapes>()
    };
    assert_eq!(read(""), Ok(Shapes::default()));
    let full = read(
        "colour = \"r\"\npair = [1, \"x\"]\nwide = -3\nnarrow = 0.5\n\
         by_joint = { 3 = [\"exact\", { kind = \"exact\" }, { scaled = 2 }, { pair = [1, 2] }] }",
    );
    let shapes = Shapes {
        color: 'r',
        pair: (1, Some("x".to_owned())),
        by_joint: BTreeMap::from([(
            3,
            vec![
                Map::Exact,
                Map::Exact,
                Map::Scaled(2.0),
                Map::Pair(1.0, 2.0),
            ],
        )]),
        narrow: 0.5,
        wide: -3,
    };
    assert_eq!(full, Ok(shapes));
    let cases = [
        (
            "colr = \"r\"",
            "1: colr: unknown key; did you mean `color`? \
             (allowed: color, colour, pair, by_joint, narrow, wide)",
        ),
        (
            "color = \"red\"",
            "1: color: expected a string of one character, found the string \"red\"",
        ),
        (
            "narrow = 1e39",
            "1: narrow: expected a number below 3.4e38 in size, found the number 1e39",
        ),
        (
            "wide = 128",
            "1: wide: expected an integer from -128 to 127, found the integer 128",
        ),
        (
            "by_joint.x = []",
            "1: by_joint.x: expected an integer as the key, found the string \"x\"",
        ),
        (
            "[by_joint]\n5 = [\n  \"exact\",\n  { scaled = true },\n]",
            "4: by_joint.5.1.scaled: expected a number, found the boolean true",
        ),
        (
            "[[by_joint.5]]\nkind = \"exact\"\n[[by_joint.5]]\nkind = \"linear\"\nridge = \"no\"",
            "5: by_joint.5.1.ridge: expected a number, found the string \"no\"",
        ),
        (
            "by_joint.5 = [{ kind = \"pair\", x = 1 }]",
            "1: by_joint.5.0: expected { name = [..] } with 2 values, found only the \
             name of the variant",
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(message(read(text)), format!("a.toml:{expected}"));
    }
    let long = format!("color = \"{}\"", "é".repeat(500));
    let quoted = format!("found a string that begins \"{}\"", "é".repeat(80));
    assert!(message(read(&long)).ends_with(&quoted));
}
