//! Dotted keys such as `action.0.bounds`, and the nearest valid name to a misspelt one.

use toml::{Table, Value};
use toml_writer::ToTomlKey;

/// The segments of a dotted key, without quotes, as TOML reads them; `None` if it is no key.
pub(crate) fn segments(key: &str) -> Option<Vec<String>> {
    if key.contains(['\n', '\r']) {
        return None;
    }
    let mut table: Table = format!("{key} = true").parse().ok()?;
    let mut segments = Vec::new();
    loop {
        let (key, value) = std::mem::take(&mut table).into_iter().next()?;
        segments.push(key);
        match value {
            Value::Table(inner) => table = inner,
            Value::Boolean(true) => return Some(segments),
            _ => return None,
        }
    }
}

/// The reverse of [`segments`].
pub(crate) fn dotted(segments: &[String]) -> String {
    let quoted: Vec<String> = segments.iter().map(ToTomlKey::to_toml_key).collect();
    quoted.join(".")
}

/// The candidate that the writer most probably meant, if one is near enough.
///
/// Near enough is a Damerau-Levenshtein distance of at most a third of the longer name (capitals
/// and `-` for `_` cost nothing), or the same name with another unit suffix, or with none.
///
/// ```
/// use stridemap_config::nearest;
///
/// let keys = ["friction", "mass_scale", "hip_deg"];
/// assert_eq!(nearest("frictoin", &keys), Some("friction"));
/// assert_eq!(nearest("Mass-Scale", &keys), Some("mass_scale"));
/// assert_eq!(nearest("hip_rad", &keys), Some("hip_deg"));
/// assert_eq!(nearest("colour", &keys), None);
/// ```
#[must_use]
pub fn nearest<'c>(name: &str, candidates: &[&'c str]) -> Option<&'c str> {
    // A file may hold any bytes: the distance costs the product of the lengths.
    if name.len() > 200 {
        return None;
    }
    let plain = |name: &str| name.to_lowercase().replace('-', "_");
    let name = plain(name);
    let distance = |candidate: &&&str| {
        let twin = plain(candidate);
        let distance = strsim::damerau_levenshtein(&name, &twin);
        let longer = name.chars().count().max(twin.chars().count());
        let near = distance <= (longer / 3).max(1) && distance < longer;
        (near || same_but_for_unit(&name, &twin)).then_some(distance)
    };
    let near = candidates.iter().filter(|c| distance(c).is_some());
    near.min_by_key(distance).copied()
}

/// `speed` and `speed_m_s`; `hip_rad` and `hip_deg`.
fn same_but_for_unit(a: &str, b: &str) -> bool {
    let extends = |long: &str, short: &str| {
        let rest = long.strip_prefix(short);
        short.len() >= 3 && rest.is_some_and(|rest| rest.starts_with('_'))
    };
    let stems = match (a.rsplit_once('_'), b.rsplit_once('_')) {
        (Some((a, _)), Some((b, _))) => a.len() >= 3 && a == b,
        _ => false,
    };
    extends(a, b) || extends(b, a) || stems
}
