//! Output for pipes and scripts: `--once` (the status as text or one document) and `--json` (a line per estimate).

use crate::link::{Announcer, LOOK_EVERY, Link, News, Whence};
use crate::model::{Model, Presence};
use crate::view::screen::now;
use crate::view::sections::text;
use serde::Serialize;
use shared_types::clock::monotonic_ns;
use shared_types::payload::status_bits;
use shared_types::{Domain, Estimate, Status};
use std::io::{Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long `--once` waits for an estimate and a status.
const ONCE_PATIENCE: Duration = Duration::from_secs(5);
/// Columns of the text of `--once`.
const TEXT_WIDTH: usize = 100;

/// An estimate with its status in words.
#[derive(Serialize)]
struct EstimateLine<'a> {
    status_words: Vec<&'static str>,
    #[serde(flatten)]
    estimate: &'a Estimate,
}

impl<'a> EstimateLine<'a> {
    fn of(estimate: &'a Estimate) -> Self {
        Self { status_words: status_bits::words(estimate.status), estimate }
    }
}

#[derive(Serialize)]
struct Document<'a> {
    estimate: EstimateLine<'a>,
    status: &'a Status,
}

/// Prints the status and the newest estimate once: as text, or as one JSON document.
///
/// # Errors
/// The reason why no estimate or status arrives within 5 s; a service of another version.
pub fn once(domain: &Domain, instance: &str, whence: Whence, json: bool) -> anyhow::Result<()> {
    let mut model = Model::new(instance);
    let mut link = Link::new(domain.clone(), instance, whence, monotonic_ns());
    let asked = Instant::now();
    let (estimate, status) = loop {
        link.look(monotonic_ns(), |news| model.note(news))?;
        match (model.estimate, model.status) {
            // New ports receive the last status of a dead service again.
            (Some(estimate), Some(status)) if status.stamp_ns + 1_000_000_000 > estimate.publish_stamp_ns => {
                break (estimate, status);
            }
            _ => {}
        }
        if asked.elapsed() > ONCE_PATIENCE {
            match model.presence {
                Presence::Away { why, .. } => anyhow::bail!("no estimate within {ONCE_PATIENCE:?}: {why}"),
                _ => anyhow::bail!(
                    "no status within {ONCE_PATIENCE:?}; does the service hang? (daemon control status)"
                ),
            }
        }
        std::thread::sleep(LOOK_EVERY);
    };
    drop(link);
    let printed = match json {
        true => serde_json::to_string_pretty(&Document {
            estimate: EstimateLine::of(&estimate),
            status: &status,
        })?,
        false => text(&model, now(&model), TEXT_WIDTH),
    };
    writeln!(stdout(), "{printed}")?;
    Ok(())
}

/// Prints each estimate as a line of JSON, until `stop` or `count` lines.
///
/// # Errors
/// A service of another version; an output that is closed.
pub fn lines(
    domain: &Domain,
    instance: &str,
    whence: Whence,
    count: Option<u64>,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let mut link = Link::new(domain.clone(), instance, whence, monotonic_ns());
    let mut announcer = Announcer::default();
    let mut left = count.unwrap_or(u64::MAX);
    while !stop.load(Ordering::Relaxed) && left > 0 {
        let mut estimates = Vec::new();
        link.look(monotonic_ns(), |news| {
            announcer.note(&news);
            if let News::Estimate(estimate) = news {
                estimates.push(estimate);
            }
        })?;
        let mut out = stdout().lock();
        for estimate in estimates.iter().take(usize::try_from(left).unwrap_or(usize::MAX)) {
            serde_json::to_writer(&mut out, &EstimateLine::of(estimate)).map_err(std::io::Error::from)?;
            writeln!(out)?;
            left -= 1;
        }
        drop(out);
        std::thread::sleep(LOOK_EVERY);
    }
    Ok(())
}
