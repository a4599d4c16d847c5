//! The processor's name and the cost of reading the clock, which printed figures depend on.

use std::time::Instant;

/// The processor's model, as the kernel names it.
pub fn cpu_model() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    // "model name" on x86, "Model" on many ARM boards.
    let line = text.lines().find(|line| line.to_ascii_lowercase().starts_with("model name"));
    let line = line.or_else(|| text.lines().find(|line| line.starts_with("Model")))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// Median of two readings of the clock with nothing in between (ns).
pub fn clock_reading_ns() -> u64 {
    let mut clock_ns: Vec<_> = (0..10_000).map(|_| Instant::now().elapsed().as_nanos() as u64).collect();
    clock_ns.sort_unstable();
    clock_ns[clock_ns.len() / 2 - 1]
}
