//! Work over several seeds.

use rayon::prelude::*;

use crate::failure::Failure;

/// The seeds `first`, `first + 1`, ..., so many.
pub fn seeds(first: u64, count: u64) -> Result<Vec<u64>, Failure> {
    let last = first.checked_add(count.saturating_sub(1)).ok_or_else(|| {
        Failure::request(format!("--seed {first} --seeds {count}: the last seed would be beyond {}", u64::MAX))
    })?;
    Ok((first..=last).collect())
}

/// Does `work` for each item on at most `threads` threads; results are in the order of the items,
/// whatever the number of threads.
pub fn over<T: Sync, R: Send>(
    items: &[T],
    threads: Option<usize>,
    work: impl Fn(&T) -> R + Sync,
) -> Result<Vec<R>, Failure> {
    if threads == Some(0) {
        return Err(Failure::request("--threads must be at least 1"));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .map_err(|error| Failure::working(format!("cannot start threads: {error}")))?;
    Ok(pool.install(|| items.par_iter().map(&work).collect()))
}
