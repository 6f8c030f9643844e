//! Colours and rules, light and dark, from one table.
//!
//! The series colours are Okabe and Ito's, which readers of every colour vision tell apart
//! (<https://jfly.uni-koeln.de/color/>); on dark ground blue, vermillion, green and purple are lightened
//! until they stand out from it. Dashes and marks repeat what colour says.

/// Name of a variable, its light and its dark value.
const PALETTE: &[(&str, &str, &str)] = &[
    ("bg", "#ffffff", "#14181d"),
    ("ink", "#1b1f24", "#e8edf2"),
    ("mut", "#57606a", "#a3adb8"),
    ("grid", "#e7eaee", "#272e36"),
    ("axis", "#8c959f", "#6e7884"),
    ("c0", "#0072b2", "#56b4e9"),
    ("c1", "#d55e00", "#f2843c"),
    ("c2", "#009e73", "#2cc79b"),
    ("c3", "#b5568f", "#e39cc6"),
    ("c4", "#e69f00", "#f0b73d"),
    ("c5", "#3a9bd9", "#a6d8f5"),
    ("c6", "#111417", "#f4f6f8"),
    ("near", "#1d4468", "#d9e9f7"),
    ("trunk", "#5c86a8", "#8fb2cf"),
    ("far", "#a9c0d3", "#4f6b84"),
    ("floor", "#f1f4f7", "#1b222a"),
];

/// How many series colours there are.
const SERIES: usize = 7;

/// Rules that use a colour: selector, property, variable.
const RULES: &[(&str, &str, &str)] = &[
    (".bg", "fill", "bg"),
    ("text", "fill", "ink"),
    (".mut", "fill", "mut"),
    (".grid", "stroke", "grid"),
    (".axis", "stroke", "axis"),
    (".ref", "stroke", "mut"),
    (".near", "fill", "near"),
    (".trunk", "fill", "trunk"),
    (".far", "fill", "far"),
    (".floor", "fill", "floor"),
    (".shade", "fill", "axis"),
];

/// Rules that hold in either theme.
const FIXED: &str = "text{font-family:Inter,\"DejaVu Sans\",system-ui,sans-serif}\
.ttl,.pnl{font-weight:600}.l{fill:none;stroke-linejoin:round;stroke-linecap:butt}\
.grid,.axis,.ref{fill:none}.cw{stroke:white}.on-dark{fill:white}.on-bright{fill:black}.shade{fill-opacity:.3}";

fn colored(prefix: &str, color: impl Fn(usize) -> String) -> String {
    let index = |name: &str| PALETTE.iter().position(|p| p.0 == name).unwrap_or(1);
    let mut css = String::new();
    for (selector, property, variable) in RULES {
        css.push_str(&format!("{prefix}{selector}{{{property}:{}}}", color(index(variable))));
    }
    for series in 0..SERIES {
        let value = color(index(&format!("c{series}")));
        css.push_str(&format!("{prefix}.s{series}{{stroke:{value}}}{prefix}.f{series}{{fill:{value}}}"));
    }
    let ground = color(index("bg"));
    css.push_str(&format!("{prefix}.sbg{{stroke:{ground}}}"));
    css
}

/// The style of a figure that stands alone: light, and dark where the viewer asks for it.
pub(crate) fn sheet_rules() -> String {
    format!(
        "{FIXED}{}@media (prefers-color-scheme:dark){{{}}}",
        colored("", |i| PALETTE[i].1.to_owned()),
        colored("", |i| PALETTE[i].2.to_owned())
    )
}

/// The style of the figures of a page: the variables of both themes, and rules that use them.
pub(crate) fn page_variables() -> (String, String, String) {
    let declare = |dark: bool| {
        PALETTE
            .iter()
            .map(|(name, light, night)| format!("--{name}:{};", if dark { night } else { light }))
            .collect::<String>()
    };
    let fixed = FIXED.replace("text{", ".sm text{").replace("}.", "}.sm .").replace(",.", ",.sm .");
    let rules = format!("{fixed}{}", colored(".sm ", |i| format!("var(--{})", PALETTE[i].0)));
    (declare(false), declare(true), rules)
}

/// Control points of a perceptually even ramp (cividis, made for colour-vision deficiency).
const CIVIDIS: [(f64, f64, f64); 9] = [
    (0.0, 32.0, 77.0),
    (9.0, 56.0, 110.0),
    (58.0, 79.0, 108.0),
    (91.0, 103.0, 112.0),
    (123.0, 127.0, 121.0),
    (158.0, 152.0, 117.0),
    (193.0, 178.0, 105.0),
    (226.0, 206.0, 85.0),
    (254.0, 232.0, 56.0),
];

/// Colour of a fraction in `[0, 1]` on the cividis ramp, `#rrggbb`.
pub(crate) fn ramp_color(fraction: f64) -> String {
    let at = fraction.clamp(0.0, 1.0) * (CIVIDIS.len() - 1) as f64;
    let i = (at.floor() as usize).min(CIVIDIS.len() - 2);
    let t = at - i as f64;
    let mix = |a: f64, b: f64| (a + t * (b - a)).round() as u8;
    let (a, b) = (CIVIDIS[i], CIVIDIS[i + 1]);
    format!("#{:02x}{:02x}{:02x}", mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_alone_knows_both_themes_and_a_page_only_names_them() {
        let alone = sheet_rules();
        assert!(alone.contains(".s0{stroke:#0072b2}"));
        assert!(alone.contains("prefers-color-scheme:dark){.bg{fill:#14181d}"));
        let (light, dark, rules) = page_variables();
        assert!(light.contains("--c0:#0072b2;") && dark.contains("--c0:#56b4e9;"));
        assert!(rules.contains(".sm .s0{stroke:var(--c0)}") && !rules.contains('#'));
    }

    #[test]
    fn the_ramp_ends_at_its_ends() {
        assert_eq!(ramp_color(0.0), "#00204d");
        assert_eq!(ramp_color(2.0), "#fee838");
    }
}
