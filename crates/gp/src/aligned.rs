//! A buffer that starts at a cache line, so that no vector straddles two.

use std::ops::{Deref, DerefMut};

/// Bytes of a cache line, and of the widest vector.
const LINE: usize = 64;
/// Entries of a line.
const ENTRIES: usize = LINE / size_of::<f64>();

/// A buffer of `f64` whose first entry lies at a cache line.
#[derive(Debug)]
pub(crate) struct Aligned {
    storage: Vec<f64>,
    start: usize,
}

impl Aligned {
    /// `length` zeros.
    pub(crate) fn zeros(length: usize) -> Self {
        let storage = vec![0.0; length + ENTRIES - 1];
        // Only speed depends on it, should there be no such offset.
        let start = storage.as_ptr().align_offset(LINE).min(ENTRIES - 1);
        Self { storage, start }
    }

    /// A copy of `values`.
    pub(crate) fn from_slice(values: &[f64]) -> Self {
        Self::zeros_with(values.len(), values)
    }

    /// A copy of `values`, cut off or filled up with zeros to `length`.
    pub(crate) fn zeros_with(length: usize, values: &[f64]) -> Self {
        let mut this = Self::zeros(length);
        let common = length.min(values.len());
        this[..common].copy_from_slice(&values[..common]);
        this
    }
}

impl Clone for Aligned {
    fn clone(&self) -> Self {
        Self::from_slice(self)
    }
}

impl Deref for Aligned {
    type Target = [f64];
    #[inline(always)]
    fn deref(&self) -> &[f64] {
        &self.storage[self.start..self.storage.len() + self.start + 1 - ENTRIES]
    }
}

impl DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64] {
        let end = self.storage.len() + self.start + 1 - ENTRIES;
        &mut self.storage[self.start..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_starts_at_a_line_and_holds_its_values() {
        for length in [0, 1, 7, 8, 100] {
            let values: Vec<f64> = (0..length).map(|i| i as f64).collect();
            let buffer = Aligned::from_slice(&values).clone();
            assert_eq!(buffer.as_ptr().align_offset(LINE), 0);
            assert_eq!(&buffer[..], &values[..]);
        }
    }
}
