//! What a fall is, by a rule on one component of the state.

use std::fmt;
use std::str::FromStr;

/// A fall: a component of the state is beyond a boundary at a section.
///
/// # Example
///
/// ```
/// use stridemap_stability::FallRule;
///
/// let rule: FallRule = "roll_deg < -12".parse()?;
/// assert_eq!(rule.to_string(), "roll_deg below -12");
/// assert!(rule.is_fall(-12.5) && !rule.is_fall(-11.0));
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FallRule {
    /// The component, by name.
    pub component: String,
    /// Whether values below the boundary are falls; otherwise those above.
    pub below: bool,
    /// The boundary, in the component's unit.
    pub boundary: f64,
}

impl FallRule {
    /// Whether a value of the component is a fall.
    #[must_use]
    pub fn is_fall(&self, value: f64) -> bool {
        if self.below { value < self.boundary } else { value > self.boundary }
    }
}

impl FromStr for FallRule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is no rule for falls; one is \"roll_deg < -12\" or \"pitch_deg > 20\"");
        let at = text.find(['<', '>']).ok_or_else(wrong)?;
        let (component, boundary) = (text[..at].trim(), text[at + 1..].trim_start_matches('=').trim());
        let boundary: f64 = boundary.parse().map_err(|_| wrong())?;
        if component.is_empty() || !boundary.is_finite() {
            return Err(wrong());
        }
        Ok(Self { component: component.into(), below: text[at..].starts_with('<'), boundary })
    }
}

impl fmt::Display for FallRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", self.component, if self.below { "below" } else { "above" }, self.boundary)
    }
}
