//! The page of `bench accuracy`: the table, and the figures of every flight, in one file without references.

use super::HORIZONS_S;
use super::cases::Case;
use super::judge::Judgement;
use super::report::{Estimators, Report, best, short};
use crate::plot::{Figure, Line, LineStyle, Panel};
use anyhow::{Context, ensure};
use std::fmt::Write;
use std::path::Path;

/// Levels of confidence at which coverage is drawn, and the halves of their intervals in deviations.
const LEVELS: [(f64, f64); 6] =
    [(0.5, 0.674), (0.68, 0.994), (0.8, 1.282), (0.9, 1.645), (0.95, 1.96), (0.99, 2.576)];

const HEAD: &str = "<!DOCTYPE html>
<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Accuracy</title>
<link rel=\"icon\" href=\"data:,\">
<style>
body { font: 15px sans-serif; margin: 2em auto; max-width: 70em; color: #222; }
table { border-collapse: collapse; font-size: 13px; }
td, th { padding: 2px 9px; text-align: right; white-space: nowrap; border-bottom: 1px solid #ddd; }
td:nth-child(-n+2), th:nth-child(-n+2) { text-align: left; }
tr.joint td { font-weight: bold; }
svg { max-width: 100%; height: auto; }
details { margin: 1em 0; } summary { font-size: 17px; cursor: pointer; }
</style></head><body>
<h1>Accuracy</h1>
<p>Root mean square of the velocity error's norm (m/s), over the second half of the time in the air; in brackets over that of the best
Kalman filter. The columns are the next sample, and coasts of these lengths with the recorded commands.</p>
";

/// Whether the page can be written: to be asked before a long measurement.
pub(super) fn check_target(file: &Path) -> anyhow::Result<()> {
    ensure!(
        file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("html")),
        "cannot write the page {}; needed: FILE.html",
        file.display()
    );
    let directory = file.parent().filter(|parent| !parent.as_os_str().is_empty());
    ensure!(
        directory.is_none_or(Path::is_dir),
        "cannot write the page {}: there is no such directory",
        file.display()
    );
    Ok(())
}

pub(super) fn write(
    file: &Path,
    cases: &[Case],
    judged: &[Estimators],
    report: &Report,
) -> anyhow::Result<()> {
    let mut page = HEAD.to_owned();
    let header: String = Report::header().iter().map(|name| format!("<th>{name}</th>")).collect();
    page += &format!("<table><tr>{header}</tr>\n");
    for cells in report.cells() {
        let class = if cells[1] == "joint" { " class=\"joint\"" } else { "" };
        let row: String = cells.iter().map(|cell| format!("<td>{}</td>", escaped(cell))).collect();
        writeln!(page, "<tr{class}>{row}</tr>").expect("a string takes everything");
    }
    page += "</table>\n";
    for sentence in report.remarks() {
        writeln!(page, "<p>{}</p>", escaped(&sentence)).expect("a string takes everything");
    }
    for (index, (case, estimators)) in cases.iter().zip(judged).enumerate() {
        let open = if index == 0 { " open" } else { "" };
        writeln!(page, "<details{open}><summary>{}</summary>", escaped(&short(&case.name)))
            .expect("a string takes everything");
        figures(estimators).iter().for_each(|figure| page += &figure.svg());
        page += "</details>\n";
    }
    page += "</body></html>\n";
    std::fs::write(file, page).with_context(|| format!("cannot write the page {}", file.display()))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

fn figures(estimators: &Estimators) -> [Figure; 4] {
    let kalman = best(&estimators.kalman, 1);
    let over_horizon = |label: &str, style: LineStyle, judgement: &Judgement| {
        let points = HORIZONS_S.iter().zip(&judgement.coasts);
        Line::new(label, style, points.filter_map(|(s, coast)| Some((*s, coast.root()?))).collect())
    };
    let horizon = Panel {
        log_y: true,
        ..Panel::new(
            "velocity error (m/s)",
            vec![
                over_horizon("joint law", LineStyle::Estimate, &estimators.joint),
                over_horizon("gradient law", LineStyle::Estimate, &estimators.gradient),
                over_horizon("Kalman filter, best at 0.5 s", LineStyle::Comparison, kalman),
                over_horizon("without learning", LineStyle::Comparison, &estimators.none),
                over_horizon("least squares", LineStyle::Comparison, &estimators.least_squares),
            ],
        )
    };
    let short_coasts = Panel::new(
        "error after 0.5 s (m/s)",
        vec![
            Line::new("joint law", LineStyle::Estimate, estimators.joint.short_coasts.clone()),
            Line::new("Kalman filter, best at 0.5 s", LineStyle::Comparison, kalman.short_coasts.clone()),
        ],
    );
    let axes = ["x", "y", "z"];
    let forces = axes.iter().enumerate().map(|(axis, name)| {
        let points = estimators.joint.forces.iter().map(|(t, force)| (*t, force[axis]));
        Line::new(name, LineStyle::Estimate, points.collect())
    });
    let residuals = axes.iter().enumerate().map(|(axis, name)| {
        let points = estimators.joint.residuals.iter().map(|(t, error)| (*t, error[axis]));
        Line::new(name, LineStyle::Estimate, points.collect())
    });
    let calibration = |horizon: usize| {
        let points = LEVELS.iter().filter_map(|(level, deviations)| {
            Some((*level, estimators.joint.part_within(horizon, *deviations)?))
        });
        Line::new(&format!("{} s coast", HORIZONS_S[horizon]), LineStyle::Estimate, points.collect())
    };
    let diagonal = Line::new("as stated", LineStyle::Guide, vec![(0.5, 0.5), (0.99, 0.99)]);
    let calibrations = (0..HORIZONS_S.len()).map(calibration).chain([diagonal]).collect();
    let panel = |label: &str, lines: Vec<Line>| Panel::new(label, lines);
    [
        Figure { log_x: true, ..Figure::new("Error over the length of a coast", "coast (s)", vec![horizon]) },
        Figure::new("Coasts over time", "time (s)", vec![short_coasts]),
        Figure::new(
            "Learned force, and errors of the next sample",
            "time (s)",
            vec![
                panel("force (N)", forces.collect()),
                panel("next sample's error (m/s)", residuals.collect()),
            ],
        ),
        Figure::new(
            "Calibration: errors within the stated interval",
            "level of confidence",
            vec![panel("part of the errors", calibrations)],
        ),
    ]
}
