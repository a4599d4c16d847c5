//! The numbers that hold what was learned, in use, at a checkpoint, or in a file.

use std::hint::black_box;

/// Coordinates of f̂_N, one run of numbers per output, and S scalars that depend on its history.
#[derive(Debug, Clone)]
pub(crate) struct Learned<const M: usize, const S: usize> {
    /// Runs beyond the outputs of a plant are empty.
    pub(crate) runs: [Vec<f64>; M],
    pub(crate) scalars: [f64; S],
}

impl<const M: usize, const S: usize> Learned<M, S> {
    /// f̂ = 0.
    pub(crate) fn zeros(n_outputs: usize, length: usize) -> Self {
        let run = |axis| written_zeros(if axis < n_outputs { length } else { 0 });
        Self { runs: std::array::from_fn(run), scalars: [0.0; S] }
    }

    /// f̂ = 0 again.
    pub(crate) fn clear(&mut self) {
        self.runs.iter_mut().for_each(|run| run.fill(0.0));
        self.scalars = [0.0; S];
    }

    pub(crate) fn n_numbers(&self) -> usize {
        self.runs.iter().map(Vec::len).sum::<usize>() + S
    }

    /// The numbers from `from` on, run after run and then the scalars, as many as `into` has room for: a million
    /// centers are not read between two deadlines, but in parts.
    pub(crate) fn read(&self, from: usize, into: &mut [f64]) {
        let mut start = 0;
        for run in self.runs.iter().map(Vec::as_slice).chain([self.scalars.as_slice()]) {
            let end = start + run.len();
            let (first, last) = (from.max(start), (from + into.len()).min(end));
            if first < last {
                into[first - from..last - from].copy_from_slice(&run[first - start..last - start]);
            }
            start = end;
        }
    }

    /// Takes numbers that were read.
    pub(crate) fn load(&mut self, numbers: &[f64]) {
        let mut rest = numbers;
        for run in &mut self.runs {
            let (own, others) = rest.split_at(run.len());
            run.copy_from_slice(own);
            rest = others;
        }
        self.scalars = rest.try_into().expect("as many numbers as were read");
    }

    /// Takes all of another.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        for (to, from) in self.runs.iter_mut().zip(&other.runs) {
            to.copy_from_slice(from);
        }
        self.scalars = other.scalars;
    }

    /// Takes the scalars and some rows, of `length` numbers each, of another.
    pub(crate) fn copy_rows_from(&mut self, other: &Self, rows: &[usize], length: usize) {
        for (to, from) in self.runs.iter_mut().zip(&other.runs).filter(|(_, from)| !from.is_empty()) {
            for row in rows {
                let place = row * length..(row + 1) * length;
                to[place.clone()].copy_from_slice(&from[place]);
            }
        }
        self.scalars = other.scalars;
    }
}

/// Zeros on mapped pages, so that the first update of a row does not wait for the kernel to map one.
fn written_zeros(n: usize) -> Vec<f64> {
    let mut zeros = vec![0.0; n];
    for page in zeros.chunks_mut(256) {
        page[0] = black_box(0.0);
    }
    zeros
}
