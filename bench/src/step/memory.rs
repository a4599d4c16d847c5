//! Measures how fast this machine reads memory, which limits a step that reads a large factor.

use std::hint::black_box;

/// Much larger than any cache.
const BUFFER_BYTES: usize = 256 << 20;
/// Read at once. The next read begins where this one ended, so that none finds its numbers in the cache.
const WINDOW_BYTES: usize = 16 << 20;

/// A buffer that is read from end to end, over and over.
pub(super) struct MemoryProbe {
    numbers: Vec<f64>,
    at: usize,
}

impl MemoryProbe {
    pub(super) fn new() -> Self {
        // Not zeros, which would be one page, mapped many times.
        Self { numbers: vec![1.0; BUFFER_BYTES / 8], at: 0 }
    }

    /// Reads the next window, as two streams: one alone comes slower.
    pub(super) fn read(&mut self) {
        let window = &self.numbers[self.at..self.at + WINDOW_BYTES / 8];
        let (first, second) = window.split_at(window.len() / 2);
        let mut sums = [[0.0; 16]; 2];
        for (first, second) in first.as_chunks::<16>().0.iter().zip(second.as_chunks::<16>().0) {
            for i in 0..16 {
                sums[0][i] += first[i];
                sums[1][i] += second[i];
            }
        }
        black_box(sums);
        self.at = (self.at + WINDOW_BYTES / 8) % self.numbers.len();
    }

    /// Bytes per ns, that is GB/s, if a read takes this long.
    pub(super) fn gb_per_s(read_ns: u64) -> f64 {
        WINDOW_BYTES as f64 / read_ns as f64
    }
}
