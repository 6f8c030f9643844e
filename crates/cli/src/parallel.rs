//! Work over several seeds.

use rayon::prelude::*;

use crate::failure::Failure;
use crate::progress::SeedProgress;

/// The seeds `first`, `first + 1`, ..., so many.
pub fn seeds(first: u64, count: u64) -> Result<Vec<u64>, Failure> {
    let last = first.checked_add(count.saturating_sub(1)).ok_or_else(|| {
        Failure::request(format!("--seed {first} --seeds {count}: the last seed would be beyond {}", u64::MAX))
    })?;
    Ok((first..=last).collect())
}

/// Does `work` for each item on at most `threads` threads, and says of each what it `told` when it is done; results
/// are in the order of the items, whatever the number of threads, and the first failure among them is returned.
pub fn over<T: Sync, R: Send, E: Send>(
    items: &[T],
    threads: Option<usize>,
    told: impl Fn(&T, &Result<R, E>) -> String + Sync,
    work: impl Fn(&T) -> Result<R, E> + Sync,
) -> Result<Vec<R>, Failure>
where
    Failure: From<E>,
{
    each_of(items, threads, "seeds", told, work)
}

/// The same for other things than seeds: cells of a table, walks.
pub fn each_of<T: Sync, R: Send, E: Send>(
    items: &[T],
    threads: Option<usize>,
    noun: &'static str,
    told: impl Fn(&T, &Result<R, E>) -> String + Sync,
    work: impl Fn(&T) -> Result<R, E> + Sync,
) -> Result<Vec<R>, Failure>
where
    Failure: From<E>,
{
    let progress = SeedProgress::new(items.len(), noun);
    let one = |item: &T| {
        let result = work(item);
        progress.done(&told(item, &result));
        result
    };
    let results: Vec<Result<R, E>> = within(threads, || items.par_iter().map(one).collect())?;
    Ok(results.into_iter().collect::<Result<_, E>>()?)
}

/// Does work that goes to several threads on at most `threads` of them.
pub fn within<R: Send>(threads: Option<usize>, work: impl FnOnce() -> R + Send) -> Result<R, Failure> {
    if threads == Some(0) {
        return Err(Failure::request("--threads must be at least 1"));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .map_err(|error| Failure::working(format!("cannot start threads: {error}")))?;
    Ok(pool.install(work))
}
