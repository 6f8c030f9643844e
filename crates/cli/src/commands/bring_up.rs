//! `init --model` and `tune`: from the model of a robot to a gait that steps, in a task file.

use std::path::{Path, PathBuf};

use serde::Serialize;
use stridemap_lab::{GaitSetting, GaitVerdict, Scale, Task, Try, TuneOptions, VARIANTS, builtin, tune as search};
use stridemap_mujoco::{Guess, ModelSource, MujocoConfig, MujocoError, MujocoRobot, guess};
use stridemap_record::files;
use stridemap_robot::{LEG_JOINTS, Side};
use toml_edit::{DocumentMut, Item, Table, TableLike, value};

use crate::args::Common;
use crate::failure::Failure;
use crate::output;
use crate::progress::duration;

/// Writes a task file for a model: its joint map, guessed, and a gait by the rule.
pub fn init_model(model: &Path, file: Option<&Path>, json: bool) -> Result<(), Failure> {
    let path = file.unwrap_or(Path::new("my-robot.toml"));
    if path.exists() {
        return Err(Failure::request(format!("{} exists; choose another name or remove it", path.display())));
    }
    let found = guess(model).map_err(|error| match error {
        MujocoError::Load { .. } => Failure::request(error.to_string()),
        error => Failure::working(error.to_string()),
    })?;
    let text = task_file(&found, path)?;
    let mut document: DocumentMut =
        text.parse().map_err(|error| Failure::working(format!("the file that was to be written: {error}")))?;
    let mut task = builtin::load("stepping", &[])?.task;
    (task.robot, task.written) = (found.config.clone(), builtin::Written::default());
    let scale = Scale::of(&task).map_err(|error| Failure::working(error.to_string()))?;
    let rule = scale.rung(1).rounded();
    put(&mut document, &rule, None, "by the rule; `stridemap tune` searches")?;
    files::write_whole(path, document.to_string().as_bytes())?;
    let shown = Found {
        file: path.display().to_string(),
        certain: found.is_certain(),
        joints: (found.joints.iter())
            .map(|j| (format!("{}.{}", j.side.name(), j.joint.name()), j.name.clone(), j.certainty))
            .collect(),
        feet: Side::BOTH.map(|side| found.config.leg(side).foot.clone()),
        heading_deg: found.config.heading_deg.unwrap_or(0.0),
        notes: found.notes.clone(),
    };
    if json {
        return output::json(&shown);
    }
    for (joint, (role, name, _)) in found.joints.iter().zip(&shown.joints) {
        let doubt = joint.doubt_deg().map(|deg| format!("   look at this: its axis is {deg:.0} deg off"));
        output::line(format!("  {role:<18} {name}{}", doubt.unwrap_or_default()));
    }
    output::line(format!("  feet               {}, {}", shown.feet[0], shown.feet[1]));
    for note in &shown.notes {
        output::line(format!("  note: {note}"));
    }
    output::line(format!("wrote {0}\n  next: stridemap tune {0}", path.display()));
    Ok(())
}

/// What `init --model` found.
#[derive(Serialize)]
struct Found {
    file: String,
    certain: bool,
    joints: Vec<(String, String, f64)>,
    feet: [String; 2],
    heading_deg: f64,
    notes: Vec<String>,
}

/// The text of a task file with a guessed map and no gait yet.
fn task_file(found: &Guess, path: &Path) -> Result<String, Failure> {
    let quoted = |text: &str| value(text).to_string().trim().to_owned();
    let ModelSource::File(model) = &found.config.model else {
        return Err(Failure::request("a model file is needed"));
    };
    let name = robot_name(model);
    let mut text = format!(
        "# Written by `stridemap init`, guessed from the model's kinematics; every key that is not here comes from the task\n\
         # that it extends. Next: `stridemap tune {0}`, `stridemap check {0}`, `stridemap learn {0}`.\n",
        path.display()
    );
    text += &format!(
        "extends = \"stepping-auto\"\nname = {}\nabout = {}\n\n[robot]\n",
        quoted(&name),
        quoted(&format!("Stepping in place on {name}"))
    );
    text += &format!("model = {}\n", quoted(&model_from(model, path)));
    let config = &found.config;
    for note in &found.notes {
        text += &format!("# {note}\n");
    }
    if !config.add.is_empty() {
        let words: Vec<String> = config.add.iter().filter_map(|missing| serde_json::to_string(missing).ok()).collect();
        text += &format!("add = [{}]\n", words.join(", "));
    }
    if !config.body_contacts {
        text += "body_contacts = false         # only the feet touch anything\n";
    }
    if let Some(step_s) = config.time_step_s {
        text += &format!("time_step_s = {step_s}\n");
    }
    if let Some(deg) = config.heading_deg {
        text += &format!("heading_deg = {deg:?}            # where it looks in the model, from +x to the left\n");
    }
    if !found.keyframes.is_empty() {
        text +=
            &format!("# keyframe = {}         # rest angles of what is not named below\n", quoted(&found.keyframes[0]));
    }
    text += "# The model's names; a minus where its axis points against Stridemap's: hip + = thigh forward, knee flexion < 0,\n\
             # ankle + = toes up, rolls about +x, yaws about +z.\n";
    for side in Side::BOTH {
        let map = config.leg(side);
        let joints = LEG_JOINTS.into_iter().filter_map(|joint| {
            let (sign, name) = map.joint(joint)?;
            let minus = if sign < 0.0 { "-" } else { "" };
            Some(format!("{} = {}", joint.name(), quoted(&format!("{minus}{name}"))))
        });
        // What a task that is extended names and this robot lacks.
        let lacks = LEG_JOINTS.into_iter().filter(|joint| map.joint(*joint).is_none() && joint.name() == "ankle_roll");
        let lacks = lacks.map(|joint| format!("{} = \"\"", joint.name()));
        let entries: Vec<String> = joints.chain(lacks).chain([format!("foot = {}", quoted(&map.foot))]).collect();
        text += &format!("{} = {{ {} }}\n", side.name(), entries.join(", "));
        for joint in found.joints.iter().filter(|joint| joint.side == side) {
            if let Some(deg) = joint.doubt_deg() {
                text += &format!(
                    "# look at {}.{}: its axis is {deg:.0} deg off what its name says\n",
                    side.name(),
                    joint.joint.name()
                );
            }
        }
    }
    Ok(text)
}

/// A name for the robot: of the model's file, or of its folder where the file is any robot's `scene.xml`.
fn robot_name(model: &Path) -> String {
    let stem = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let name = match stem(model).as_str() {
        "scene" | "robot" | "model" => model.parent().map(stem).unwrap_or_default(),
        name => name.to_owned(),
    };
    let name: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
    if name.is_empty() { "my-robot".into() } else { name }
}

/// The model's path from the task file's place.
fn model_from(model: &Path, file: &Path) -> String {
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let (model, file) = (absolute(model), absolute(file));
    let near = file.parent().and_then(|dir| model.strip_prefix(dir).ok());
    near.map_or(model.clone(), PathBuf::from).display().to_string()
}

/// Puts a setting into a task file, with a word on each number that has none. Comments stay.
fn put(document: &mut DocumentMut, setting: &GaitSetting, walk: Option<(f64, f64)>, from: &str) -> Result<(), Failure> {
    let in_place = walk.map_or_else(
        || "in place".to_owned(),
        |(deg, speed_m_s)| format!("in place; with {deg} it walks at {speed_m_s:.2} m/s"),
    );
    let [hip, knee, ankle] = setting.rest_deg;
    let numbers: [(&[&str], f64, &str); 14] = [
        (&["robot", "kp_nm_rad"], setting.kp_nm_rad, "stiffness of the leg joints, instead of the model's own"),
        (&["robot", "kv_nms_rad"], setting.kv_nms_rad, "damping, instead of the model's own"),
        (&["robot", "rest_deg", "hip_pitch"], hip, "a crouch"),
        (&["robot", "rest_deg", "knee"], knee, ""),
        (&["robot", "rest_deg", "ankle_pitch"], ankle, "soles level, mass over them"),
        (&["gait", "natural_frequency_rad_s"], setting.natural_frequency_rad_s, "near sqrt(g / height of the mass)"),
        (&["gait", "coupling_rad_s"], setting.coupling_rad_s, ""),
        (&["gait", "amplitude_deg", "hip_roll"], setting.hip_roll_deg, "sway"),
        (&["gait", "amplitude_deg", "ankle_roll"], setting.ankle_roll_deg, ""),
        (&["gait", "amplitude_deg", "pitch"], setting.pitch_deg, "lifts the feet"),
        (&["gait", "phase", "position_filter_s"], setting.position_filter_s, ""),
        (&["gait", "phase", "velocity_filter_s"], setting.velocity_filter_s(), ""),
        (&["gait", "phase", "half_stance_m"], setting.half_stance_m, "half the distance of the feet"),
        (&["gait", "amplitude_deg", "walk"], 0.0, &in_place),
    ];
    for (key, number, why) in numbers {
        put_number(document, key, number, why)?;
    }
    if let Some(Item::Table(gait)) = document.as_table_mut().get_mut("gait") {
        let before = gait.decor().prefix().and_then(|prefix| prefix.as_str()).unwrap_or("\n");
        let kept: Vec<&str> = before.lines().filter(|line| !line.starts_with("# A gait ")).collect();
        let kept = kept.join("\n");
        gait.decor_mut().set_prefix(format!(
            "{}\n# A gait {from}.\n",
            if kept.is_empty() { "" } else { kept.trim_end_matches('\n') }
        ));
    }
    Ok(())
}

/// Puts a number into a task file, with a word on it where it is new.
fn put_number(document: &mut DocumentMut, key: &[&str], number: f64, why: &str) -> Result<(), Failure> {
    let Some((last, tables)) = key.split_last() else { return Ok(()) };
    let mut table: &mut dyn TableLike = document.as_table_mut();
    // A comment would end an inline table's line.
    let mut inline = false;
    for name in tables {
        let entry = table.entry(name).or_insert_with(|| Item::Table(Table::new()));
        inline |= entry.is_inline_table();
        table = entry.as_table_like_mut().ok_or_else(|| {
            Failure::request(format!("{}: is no table, so that {last} cannot be written into it", tables.join(".")))
        })?;
    }
    let number = format!("{number:.4e}").parse().unwrap_or(number);
    let mut new = value(number);
    if let Some(new) = new.as_value_mut() {
        match table.get(last).and_then(Item::as_value) {
            Some(old) => *new.decor_mut() = old.decor().clone(),
            None if !why.is_empty() && !inline => new.decor_mut().set_suffix(format!("  # {why}")),
            None => {}
        }
    }
    table.insert(last, new);
    Ok(())
}

/// What `tune` prints.
#[derive(Serialize)]
struct TunedShown {
    steps: bool,
    tries: usize,
    tries_to_first_step: Option<usize>,
    simulated_s: f64,
    simulated_to_first_step_s: f64,
    wall_s: f64,
    robust: Option<usize>,
    variants: usize,
    clearance_m: f64,
    stride_s: f64,
    both_feet_share: f64,
    walk: Option<(f64, f64)>,
    gains_replaced: Option<String>,
    task: String,
    picture: Option<String>,
    best: Try,
}

/// Searches a gait that steps and writes it into the task file.
pub fn tune(file: &Path, tries: usize, walk: bool, common: &Common) -> Result<(), Failure> {
    let name = super::verbs::text(file)?;
    if !common.sets.is_empty() || common.robot.is_some() {
        return Err(Failure::request("tune writes what it finds into the file: say there what --set or --robot would"));
    }
    if file.file_name().is_some_and(|name| name == "config.toml") && file.with_file_name("provenance.json").exists() {
        return Err(Failure::request(format!(
            "{}: is a run's record; tune the task file it came from",
            file.display()
        )));
    }
    let loaded = builtin::load(name, &[])?;
    let Some(path) = loaded.file.clone() else {
        return Err(Failure::request(format!(
            "{name} is built in and stays as it is; write a file of your own: stridemap init --model MODEL my-robot.toml"
        )));
    };
    // What the actions and thresholds of the task are is not asked yet.
    let mut task = builtin::load("stepping", &[])?.task;
    (task.robot, task.gait, task.written) = (loaded.task.robot, loaded.task.gait, loaded.task.written);
    let text = std::fs::read_to_string(&path).map_err(|e| Failure::request(format!("{}: {e}", path.display())))?;
    let mut document: DocumentMut = text.parse().map_err(|e| Failure::request(format!("{}: {e}", path.display())))?;
    let time_step_s = own_time_step_s(&task);
    task.robot.time_step_s = time_step_s.or(task.robot.time_step_s);
    let replaced = replaced(&task);
    let started = std::time::Instant::now();
    let options = TuneOptions { seed: common.seed, most_tries: tries, walk };
    let mut said = |number: usize, tried: &Try| output::note(in_words(number, tried));
    let found = super::super::parallel::within(common.threads, || search(&task, &options, &mut said))??;
    let best = found.best().clone();
    let steps = best.verdict == GaitVerdict::Steps;
    let picture = super::picture::tried(&path, &found.tries, steps.then_some(found.chosen))
        .map_err(|failure| output::note(format!("no picture of the gaits that were tried: {}", failure.error())))
        .ok();
    if steps {
        let gained = match best.robust {
            Some(robust) => {
                format!("found by `stridemap tune` (seed {}): up in {robust} of {VARIANTS} variants", common.seed)
            }
            None => format!("found by `stridemap tune` (seed {})", common.seed),
        };
        put(&mut document, &best.setting, best.walk, &gained)?;
        if let Some(step_s) = time_step_s {
            put_number(
                &mut document,
                &["robot", "time_step_s"],
                step_s,
                "the model's own does not go into the control period",
            )?;
        }
        if std::fs::read_to_string(&path).ok().as_ref() != Some(&text) {
            return Err(Failure::working(format!(
                "{}: was edited while the search went on, and is left as it is; run tune again (the same seed finds the same gait)",
                path.display()
            )));
        }
        let mut wanted = task.clone();
        best.setting.put_into(&mut wanted);
        wanted.gait.amplitude_deg.walk = 0.0;
        write_proven(&path, &as_lines_of(&text, &document.to_string()), &wanted)?;
    }
    let shown = TunedShown {
        steps,
        tries: found.tries.len(),
        tries_to_first_step: found.first_step,
        simulated_s: found.simulated_s[1],
        simulated_to_first_step_s: found.simulated_s[0],
        wall_s: started.elapsed().as_secs_f64(),
        robust: best.robust,
        variants: VARIANTS,
        clearance_m: best.stepping.clearance_m,
        stride_s: best.stepping.stride_s,
        both_feet_share: best.stepping.both_feet_share,
        walk: best.walk,
        gains_replaced: replaced.map(|own| format!("{own} by {:.0} N m/rad", best.setting.kp_nm_rad)),
        task: path.display().to_string(),
        picture: picture.map(|path| path.display().to_string()),
        best,
    };
    if common.json {
        output::json(&shown)?;
    } else {
        show(&shown, name);
    }
    if steps {
        return Ok(());
    }
    let s = &shown.best;
    Err(Failure::working(format!(
        "no gait steps after {} tries; the nearest stayed up for {:.1} s with both feet loaded {:.0} % of the time{}; the file \
         is as it was",
        shown.tries,
        s.survived_s,
        100.0 * s.stepping.both_feet_share,
        s.stepping.falling.as_ref().map(|how| format!(", and fell {how}")).unwrap_or_default()
    )))
}

/// A text with the byte order mark and the line ends of another.
fn as_lines_of(of: &str, text: &str) -> String {
    let mark = if of.starts_with('\u{feff}') { "\u{feff}" } else { "" };
    let lines = text.trim_start_matches('\u{feff}').replace("\r\n", "\n");
    format!("{mark}{}", if of.contains("\r\n") { lines.replace('\n', "\r\n") } else { lines })
}

/// Writes a task file if it reads as the robot and gait that are wanted.
fn write_proven(path: &Path, text: &str, wanted: &Task) -> Result<(), Failure> {
    let aside = path.with_file_name(format!(".{}.tuned", path.file_name().unwrap_or_default().to_string_lossy()));
    files::write_whole(&aside, text.as_bytes())?;
    let read = builtin::load_file(&aside, &[]);
    let removed = std::fs::remove_file(&aside);
    let why = match read {
        Ok(now) if now.task.gait == wanted.gait && now.task.robot == wanted.robot => {
            removed.map_err(|error| Failure::working(format!("{}: {error}", aside.display())))?;
            return Ok(files::write_whole(path, text.as_bytes())?);
        }
        Ok(_) => "it would read as another gait".to_owned(),
        Err(error) => error.to_string(),
    };
    Err(Failure::working(format!(
        "{}: what was found cannot be written into it ({why}); the file is as it was: write [robot] and [gait] as tables",
        path.display()
    )))
}

fn show(shown: &TunedShown, name: &str) {
    let s = &shown.best.stepping;
    output::line(format!(
        "{}: {} tries, {:.0} s simulated in {}; the first that steps was number {}",
        if shown.steps { "steps" } else { "does not step" },
        shown.tries,
        shown.simulated_s,
        duration(shown.wall_s),
        shown.tries_to_first_step.map_or("none".into(), |n| n.to_string())
    ));
    output::line(format!(
        "  a step takes {:.2} s, feet clear {:.1} mm, both carry load {:.0} % of the time, psi_roll spreads {:.2} deg",
        s.stride_s,
        1e3 * s.clearance_m,
        100.0 * s.both_feet_share,
        s.psi_roll_spread_deg
    ));
    if let Some(robust) = shown.robust {
        output::line(format!(
            "  up in {robust} of {VARIANTS} variants (start noise three times, friction 0.6, mass x1.05 and x0.95, kp x0.8, pushes)"
        ));
    }
    if let Some((walk_deg, speed_m_s)) = shown.walk {
        output::line(format!("  with gait.amplitude_deg.walk = {walk_deg} it walks at {speed_m_s:.2} m/s"));
    }
    if let Some(replaced) = &shown.gains_replaced {
        output::line(format!("  stiffness replaced: {replaced}"));
    }
    if let Some(picture) = &shown.picture {
        output::line(format!("  every gait that was tried: {picture}"));
    }
    if shown.steps {
        output::line(format!("wrote {}\n  next: stridemap check {name}, then stridemap learn {name}", shown.task));
    }
}

/// One try in a line.
fn in_words(number: usize, tried: &Try) -> String {
    let what = match tried.verdict {
        GaitVerdict::Steps => "steps".to_owned(),
        GaitVerdict::Shuffles => {
            format!("shuffles (both feet loaded {:.0} %)", 100.0 * tried.stepping.both_feet_share)
        }
        GaitVerdict::Falls => format!("falls after {:.1} s", tried.survived_s),
    };
    format!(
        "try {number} ({}): pitch {:.1} deg, roll {:.1} deg, {:.2} rad/s: {what}, feet clear {:.1} mm",
        tried.from,
        tried.setting.pitch_deg,
        tried.setting.hip_roll_deg,
        tried.setting.natural_frequency_rad_s,
        1e3 * tried.stepping.clearance_m
    )
}

/// A physics step that goes into the control period, where the model's own does not and the file names none.
fn own_time_step_s(task: &Task) -> Option<f64> {
    let gains = |gains: &Option<stridemap_mujoco::PerJoint>| gains.clone().or_else(|| Some(1.0.into()));
    let robot = MujocoConfig {
        kp_nm_rad: gains(&task.robot.kp_nm_rad),
        kv_nms_rad: gains(&task.robot.kv_nms_rad),
        ..task.robot.clone()
    };
    let refused = matches!(MujocoRobot::new(robot), Err(MujocoError::PeriodNotMultiple { .. }));
    (refused && task.robot.time_step_s.is_none()).then_some(0.5 * task.robot.control_period_s)
}

/// The stiffness that the model's servos have of their own.
fn replaced(task: &Task) -> Option<String> {
    let robot = MujocoRobot::new(MujocoConfig { kp_nm_rad: None, ..task.robot.clone() }).ok()?;
    let [least, most] = robot.servo_stiffness()?;
    let range = if most - least < 0.5 { format!("{least:.0}") } else { format!("{least:.0} to {most:.0}") };
    Some(format!("{range} N m/rad of the model"))
}
