//! Resolved text, read again, is the same configuration.

use super::*;
use crate::config::to_toml;

fn maps() -> [Map; 5] {
    [
        Map::Gp {
            sample: Sample::Mean,
            samples: 3,
        },
        Map::Linear(Linear { ridge: 1e-300 }),
        Map::Scaled(0.1),
        Map::Pair(1.0, f64::INFINITY),
        Map::Exact,
    ]
}

#[test]
fn typed_configuration_round_trips() {
    let mut task = with("strides", "strides = 1").unwrap();
    for map in maps() {
        task.map = map;
        let text = to_toml(&task).unwrap();
        let again: Task = Document::parse("config.toml", &text)
            .unwrap()
            .deserialize()
            .unwrap();
        assert_eq!(again, task, "{text}");
    }
}

#[test]
fn every_value_is_written_as_a_user_writes_it() {
    let task = with("strides", "strides = 1").unwrap();
    assert_eq!(
        to_toml(&task).unwrap(),
        "strides = 1\n\n\
         [robot]\nfriction = 0.7\nmass_scale = 1.0\nmirrored = false\n\n\
         [robot.rest_deg]\nhip_pitch = 15.0\nknee = -30.5\n\n\
         [map]\nkind = \"gp\"\nsample = \"latent\"\nsamples = 60\n\n\
         [[action]]\nmodulates = \"walk_amplitude_deg\"\nbounds = [0.0, 12.0]\n\n\
         [[action]]\nmodulates = \"phase_rad\"\nbounds = [-1.0, 1.0]\n"
    );
}

#[test]
fn resolved_text_round_trips_with_its_layers() {
    let child = "extends = \"task\"\n[robot]\nfriction = 0.1\n";
    let tasks = [("task", GOOD), ("child", child)];
    let document = Document::load("child", &sets(&["seed=9"]), files(&tasks)).unwrap();
    let again = Document::parse("config.toml", &document.to_toml()).unwrap();
    assert!(again.root().same_value(document.root()));
    assert_eq!(again.deserialize::<Task>(), document.deserialize::<Task>());
}

#[test]
fn what_toml_cannot_hold_is_refused_by_key() {
    let mut task = with("strides", "strides = 1").unwrap();
    task.robot.friction = f64::NAN;
    assert_eq!(
        message(to_toml(&task)),
        "robot.friction: expected a number, found nan"
    );
    task.robot.friction = 1.0;
    task.seed = Some(u64::MAX);
    assert_eq!(
        message(to_toml(&task)),
        "seed: expected an integer of at most 64 bits with its sign, found the integer \
         18446744073709551615"
    );
    assert_eq!(
        message(to_toml(&3)),
        "expected a table, found the integer 3"
    );
}

#[test]
fn awkward_keys_and_strings_round_trip() {
    let text = "\"\" = 1\n\"a.b\" = \"\\u0001\\\"\\\\\\u007f\"\n'quo\"te' = '''\nline\r\n'''\n\
                nested = [[{ \"a b\" = [] }, 1], [], {}]\nempty = {}\n[[t]]\n[[t]]\nx.y = -0.0";
    let document = Document::parse("a.toml", text).unwrap();
    let written = document.to_toml();
    let again = Document::parse("b.toml", &written).unwrap();
    assert!(again.root().same_value(document.root()), "{written}");
}
