//! `list`: the parts that a task file may name.

use serde::Serialize;
use stridemap_lab::{Part, Registry, RobotChoice, gaits, learners, rewards, states};
use stridemap_section::SectionEvent;

use crate::args::PartKind;
use crate::failure::Failure;
use crate::output;

/// A part, as it is listed.
#[derive(Serialize)]
struct Listed {
    name: &'static str,
    about: &'static str,
}

fn listed<P: Part + ?Sized>(registry: &Registry<P>) -> Vec<Listed> {
    let all = registry.all().into_iter();
    all.map(|part| Listed { name: part.name(), about: part.about() }).collect()
}

/// Prints the parts of a kind, a line each.
pub fn list(kind: PartKind, json: bool) -> Result<(), Failure> {
    let parts = match kind {
        PartKind::Gaits => listed(gaits()),
        PartKind::Learners => listed(learners()),
        PartKind::Rewards => listed(rewards()),
        PartKind::States => listed(states()),
        PartKind::Events => SectionEvent::ALL.map(|event| Listed { name: event.name, about: event.about }).into(),
        PartKind::Robots => RobotChoice::ALL.map(|robot| Listed { name: robot.name(), about: robot.about() }).into(),
    };
    if json {
        return output::json(&parts);
    }
    let width = parts.iter().map(|p| p.name.len()).max().unwrap_or(0);
    for part in parts {
        output::line(format!("{:width$}  {}", part.name, part.about));
    }
    Ok(())
}
