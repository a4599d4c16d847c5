//! Output of the commands: tables, numbers, progress, shared messages.

use comfy_table::{CellAlignment, Table, presets};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use shared_types::{logln, outln};
use std::sync::atomic::{AtomicBool, Ordering};

/// A table whose first `n_names` columns name a row, and whose others hold numbers.
pub(crate) fn table<R, C>(header: &[&str], n_names: usize, rows: R) -> Table
where
    R: IntoIterator<Item = C>,
    C: IntoIterator<Item = String>,
{
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED).set_header(header.iter().copied());
    for row in rows {
        table.add_row(row);
    }
    for column in table.column_iter_mut().skip(n_names) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// Three digits, without an exponent.
pub(crate) fn three_digits(value: f64) -> String {
    match value {
        _ if value < 0.9995 => format!("{value:.3}"),
        _ if value < 9.995 => format!("{value:.2}"),
        _ if value < 99.95 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

/// Three digits of a time in microseconds.
pub(crate) fn microseconds(ns: u64) -> String {
    three_digits(ns as f64 * 1e-3)
}

/// Prints one JSON document, or calls `print`.
pub(crate) fn show(json: bool, document: &impl Serialize, print: impl FnOnce()) -> anyhow::Result<()> {
    match json {
        true => outln!("{}", serde_json::to_string_pretty(document)?),
        false => print(),
    }
    Ok(())
}

/// A progress bar; silent where stderr is not a terminal.
pub(crate) fn progress_bar(length: u64, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).expect("a constant template");
    ProgressBar::new(length).with_style(style.progress_chars("=> "))
}

pub(crate) fn warn_of_debug_build() {
    if cfg!(debug_assertions) {
        logln!("warning: this is a debug build, its latencies mean nothing; use cargo run --release");
    }
}

pub(crate) fn say_if_stopped(stop: &AtomicBool) {
    if stop.load(Ordering::Relaxed) {
        logln!("bench: stopped; the figures are those of the part that ran");
    }
}
