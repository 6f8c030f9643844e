//! The nearest valid name to a misspelt one.

/// The candidate that the writer most probably meant, if one is near enough.
///
/// Near enough is a Damerau-Levenshtein distance of at most a third of the longer name (capitals
/// and `-` for `_` cost nothing), or the same name with another unit suffix, or with none.
///
/// ```
/// use stridemap_lab::config::nearest;
///
/// let keys = ["friction", "mass_scale", "hip_deg"];
/// assert_eq!(nearest("frictoin", &keys), Some("friction"));
/// assert_eq!(nearest("Mass-Scale", &keys), Some("mass_scale"));
/// assert_eq!(nearest("hip_rad", &keys), Some("hip_deg"));
/// assert_eq!(nearest("colour", &keys), None);
/// ```
#[must_use]
pub fn nearest<'c, S: AsRef<str>>(name: &str, candidates: &'c [S]) -> Option<&'c str> {
    let name = plain(name);
    // A file may hold any bytes: the distance costs the product of the lengths.
    if name.len() > 200 {
        return None;
    }
    let mut best: Option<(usize, &str)> = None;
    for candidate in candidates {
        let candidate = candidate.as_ref();
        let twin = plain(candidate);
        let distance = strsim::damerau_levenshtein(&name, &twin);
        let longer = name.chars().count().max(twin.chars().count());
        let near = distance <= (longer / 3).max(1) && distance < longer;
        if (near || same_but_for_unit(&name, &twin))
            && best.is_none_or(|(least, _)| distance < least)
        {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

fn plain(name: &str) -> String {
    name.to_lowercase().replace('-', "_")
}

/// `speed` and `speed_m_s`; `hip_rad` and `hip_deg`.
fn same_but_for_unit(a: &str, b: &str) -> bool {
    let extends = |long: &str, short: &str| {
        short.len() >= 3
            && long
                .strip_prefix(short)
                .is_some_and(|rest| rest.starts_with('_'))
    };
    let stems = match (a.rsplit_once('_'), b.rsplit_once('_')) {
        (Some((a, _)), Some((b, _))) => a.len() >= 3 && a == b,
        _ => false,
    };
    extends(a, b) || extends(b, a) || stems
}
