//! Fetches MuJoCo's shared library once, checks its SHA-256, and leaves it in `third_party/mujoco`.
//!
//! The library comes from the Python wheel `mujoco`, which package indices and their mirrors carry
//! for every platform: no system package, no code host. A file that is already there is only checked.

#![allow(clippy::panic, clippy::print_stdout)]

use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

/// Name of the library in the wheel; also its SONAME.
const LIBRARY: &str = "libmujoco.so.3.17.0";
/// The wheel that holds it.
const WHEEL: &str = "mujoco==3.17.0";

/// Where the library for one target comes from.
struct Source {
    /// `CARGO_CFG_TARGET_ARCH` on Linux with the GNU C library.
    arch: &'static str,
    /// Platform tag of the wheel.
    platform: &'static str,
    /// SHA-256 of the library inside.
    sha256: &'static str,
}

/// Targets with a known library.
const SOURCES: [Source; 2] = [
    Source {
        arch: "x86_64",
        platform: "manylinux_2_28_x86_64",
        sha256: "23496b023ee80fb61ab71167e94bc649f9941710fde96b18bb8204fb332523ad",
    },
    Source {
        arch: "aarch64",
        platform: "manylinux_2_28_aarch64",
        sha256: "e2edd0204fb9229f75f332a4fcd1a32345bb9f90651dc0fddfa20ec0670db789",
    },
];

/// Takes one member out of a wheel (a zip): wheel, member, destination.
const EXTRACT: &str = "import sys, zipfile; \
    open(sys.argv[3], 'wb').write(zipfile.ZipFile(sys.argv[1]).read(sys.argv[2]))";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if std::env::var_os("DOCS_RS").is_some() {
        return;
    }
    match provide() {
        Ok(directory) => {
            println!("cargo::rerun-if-changed={}", directory.join(LIBRARY).display());
            println!("cargo::metadata=libdir={}", directory.display());
            // Programs find the library by the rpath of .cargo/config.toml. What cargo itself runs (doc tests
            // lie in a temporary directory) also searches link directories below the target directory.
            if let Err(why) = link_into_out_dir(&directory.join(LIBRARY)) {
                println!("cargo::warning=doc tests will not find {LIBRARY}: {why}");
            }
        }
        Err(why) => {
            for line in why.lines() {
                println!("cargo::error={line}");
            }
            std::process::exit(1);
        }
    }
}

/// Gives cargo a directory with the library that it puts on the search path of what it runs.
fn link_into_out_dir(library: &Path) -> Result<(), String> {
    let out = PathBuf::from(std::env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?).join("lib");
    std::fs::create_dir_all(&out).map_err(|e| e.to_string())?;
    let link = out.join(LIBRARY);
    std::fs::remove_file(&link).ok();
    std::fs::hard_link(library, &link)
        .or_else(|_| std::fs::copy(library, &link).map(|_| ()))
        .map_err(|e| e.to_string())?;
    println!("cargo::rustc-link-search=native={}", out.display());
    Ok(())
}

/// Makes sure that the right library is in place; returns its directory.
fn provide() -> Result<PathBuf, String> {
    let directory =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../third_party/mujoco").canonicalize().map_err(|e| {
            format!("third_party/mujoco is missing beside the sources ({e}): build from a checkout of the repository")
        })?;
    let variable = |name| std::env::var(name).unwrap_or_default();
    let (os, env, arch) =
        (variable("CARGO_CFG_TARGET_OS"), variable("CARGO_CFG_TARGET_ENV"), variable("CARGO_CFG_TARGET_ARCH"));
    let source = SOURCES
        .iter()
        .find(|s| s.arch == arch && os == "linux" && env == "gnu")
        .ok_or_else(|| {
            format!(
                "stridemap-mujoco knows no MuJoCo library for {arch}-{os}-{env}; supported: x86_64 and aarch64 Linux with glibc.\n\
                 Elsewhere: build MuJoCo 3.17.0, add its SHA-256 to SOURCES in crates/mujoco/build.rs, its name to \
                 third_party/mujoco and an rpath to .cargo/config.toml. Every other crate builds without MuJoCo."
            )
        })?;
    let library = directory.join(LIBRARY);
    if !library.exists() {
        fetch(source, &directory).map_err(|why| {
            format!(
                "MuJoCo's library could not be fetched: {why}\n\
                 Either install python3 with pip (Debian and Ubuntu: apt install python3-pip) and let it reach a package index,\n\
                 or take mujoco/{LIBRARY} out of the wheel {WHEEL} for {} (a zip file) and put it at {}",
                source.platform,
                library.display()
            )
        })?;
    }
    let found = sha256(&library)?;
    if found != source.sha256 {
        return Err(format!(
            "{} is not the expected library: SHA-256 {found}, expected {}. Delete it to have it fetched anew.",
            library.display(),
            source.sha256
        ));
    }
    Ok(directory)
}

/// Downloads the wheel, takes the library out, checks it and moves it into place in one rename.
fn fetch(source: &Source, directory: &Path) -> Result<(), String> {
    let scratch = PathBuf::from(std::env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    let download = scratch.join("wheel");
    std::fs::create_dir_all(&download).map_err(|e| format!("{}: {e}", download.display()))?;
    python(
        "python3 -m pip download",
        Command::new("python3")
            .args(["-m", "pip", "download", "--no-deps", "--only-binary=:all:"])
            .args(["--implementation=cp", "--python-version=3.11", "--abi=cp311"])
            .arg(format!("--platform={}", source.platform))
            .args(["--disable-pip-version-check", "--quiet", "--dest"])
            .arg(&download)
            .arg(WHEEL),
    )?;
    let wheel = std::fs::read_dir(&download)
        .map_err(|e| e.to_string())?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .find(|path| path.extension().is_some_and(|e| e == "whl"))
        .ok_or("pip reported success but left no wheel")?;
    let partial = directory.join(format!("{LIBRARY}.{}.tmp", std::process::id()));
    python(
        "python3 (zipfile)",
        Command::new("python3").arg("-c").arg(EXTRACT).arg(&wheel).arg(format!("mujoco/{LIBRARY}")).arg(&partial),
    )?;
    let found = sha256(&partial)?;
    if found != source.sha256 {
        std::fs::remove_file(&partial).ok();
        return Err(format!("the wheel holds a library with SHA-256 {found}, expected {}", source.sha256));
    }
    std::fs::rename(&partial, directory.join(LIBRARY)).map_err(|e| e.to_string())?;
    std::fs::remove_dir_all(&download).ok();
    Ok(())
}

/// Runs a Python command; an error carries what it said.
fn python(what: &str, command: &mut Command) -> Result<(), String> {
    let output = command.output().map_err(|e| format!("{what} could not be started ({e})"))?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let last: Vec<&str> = said.trim().lines().rev().take(4).collect();
    let last: Vec<&str> = last.into_iter().rev().collect();
    Err(format!("{what} failed: {}", last.join(" | ")))
}

/// SHA-256 of a file, in hex.
fn sha256(path: &Path) -> Result<String, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect())
}
