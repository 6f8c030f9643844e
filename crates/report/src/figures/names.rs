//! Column names as labels of axes.

use crate::draw::{Axis, number};

/// Units by the end of a column's name, longest first.
const UNITS: &[(&str, &str)] = &[
    ("_deg_s", "deg/s"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_deg", "deg"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_nm", "N m"),
    ("_m", "m"),
    ("_s", "s"),
    ("_n", "N"),
];

/// Splits a column's name into the quantity as it is printed and its unit (empty if it has none).
pub(crate) fn quantity(name: &str) -> (String, &'static str) {
    let found = UNITS.iter().find_map(|(end, unit)| name.strip_suffix(end).map(|q| (q, *unit)));
    let (bare, unit) = found.unwrap_or((name, ""));
    let printed = match bare {
        "psi_roll" => "ψ_{roll}".to_owned(),
        "psi_pitch" => "ψ_{pitch}".to_owned(),
        "psi_pitch_rate" => "dψ_{pitch}/dt".to_owned(),
        "step_amplitude" => "A_{step}".to_owned(),
        "walk_amplitude" => "A_{walk}".to_owned(),
        "ankle_step_amplitude" | "ankle_roll_amplitude" => "A_{a,step}".to_owned(),
        other => other.replace('_', " "),
    };
    (printed, unit)
}

/// `ψ_{roll}(k + 1) (deg)`.
pub(crate) fn label(name: &str, argument: &str) -> String {
    let (quantity, unit) = quantity(name);
    let unit = if unit.is_empty() { String::new() } else { format!(" ({unit})") };
    format!("{quantity}{argument}{unit}")
}

/// An axis for rewards: logarithmic below the smallest size that matters, even near zero. Rewards that
/// are not all negative, such as speeds, get an even axis.
pub(crate) fn reward_axis(label: &str, values: &[f64]) -> Axis {
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let (lo, hi) = crate::draw::extent(finite.iter().copied());
    if finite.is_empty() || hi > 1e-9 || lo > -1e-2 {
        return Axis::covering(label, finite);
    }
    let mut sizes: Vec<f64> = finite.iter().map(|v| v.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let typical = sizes[sizes.len() / 4].max(1e-4);
    let linear = 10f64.powf(typical.log10().floor()).clamp(1e-4, 1e-1);
    Axis::symlog(label, lo * 1.3, linear * 0.5, linear)
}

/// What the axis of [`reward_axis`] needs said in a caption.
pub(crate) fn scale_note(axis: &Axis) -> String {
    match axis.scale {
        crate::draw::Scale::SymLog { linear } => {
            format!(" Vertical axis linear within ±{}, logarithmic beyond.", number(linear, 1))
        }
        crate::draw::Scale::Linear => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_come_from_the_end_of_the_name() {
        assert_eq!(label("psi_roll_deg", "(k)"), "ψ_{roll}(k) (deg)");
        assert_eq!(label("psi_pitch_rate_deg_s", ""), "dψ_{pitch}/dt (deg/s)");
        assert_eq!(label("ankle_lean_deg", ""), "ankle lean (deg)");
        assert_eq!(label("reward", ""), "reward");
    }
}
