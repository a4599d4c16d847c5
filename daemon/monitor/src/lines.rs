//! Output for pipes and scripts: `--once` (the status as text or one document) and `--json` (a line per estimate).

use crate::link::{Announcer, LOOK_EVERY, Link, News, Whence};
use crate::model::Model;
use crate::view::screen::now;
use crate::view::sections::text;
use serde::Serialize;
use shared_types::clock::monotonic_ns;
use shared_types::payload::status_bits;
use shared_types::{Client, ClientError, Domain, Estimate, Status};
use std::io::{Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

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
/// `NoDaemon` or a sentence, where no service is heard within 5 s.
pub fn once(domain: &Domain, instance: &str, whence: Whence, json: bool) -> anyhow::Result<()> {
    let mut model = Model::new(instance);
    {
        let client = Client::connect(domain, instance, ONCE_PATIENCE);
        if client.is_err() {
            // The connection attempt may have made the domain: remove it again if it is empty.
            let _ = domain.remove_if_unused();
        }
        let client = match client {
            Err(ClientError::NoDaemon { .. }) if whence == Whence::AnotherMachine => anyhow::bail!(
                "nothing of '{instance}' comes over the link within {} s; needed: its service, a tunnel on its machine and one here (docs/across-machines.md)",
                ONCE_PATIENCE.as_secs()
            ),
            client => client?,
        };
        let mut statuses = client.status_subscriber()?;
        let mut estimates = client.estimate_subscriber()?;
        let asked_ns = monotonic_ns();
        // The last message of a dead service is older than this call. With stamps of another machine's clock, only a
        // second message shows that the service is alive.
        let is_new = |stamp_ns: u64, n_heard: &mut u64| {
            *n_heard += 1;
            match whence {
                Whence::ThisMachine => stamp_ns + 1_000_000_000 > asked_ns,
                Whence::AnotherMachine => *n_heard > 1,
            }
        };
        let (mut n_statuses, mut n_estimates) = (0, 0);
        while model.estimate.is_none() || model.status.is_none() {
            let waited_s = (monotonic_ns() - asked_ns) as f64 / 1e9;
            anyhow::ensure!(
                waited_s < ONCE_PATIENCE.as_secs_f64(),
                "no {} within {waited_s:.1} s; does the service run? (daemon control status)",
                if model.estimate.is_none() { "estimate" } else { "status" },
            );
            while let Some(status) = statuses.take()? {
                if is_new(status.stamp_ns, &mut n_statuses) {
                    model.note(News::Status(status));
                }
            }
            while let Some(estimate) = estimates.take()? {
                if whence == Whence::AnotherMachine {
                    model.clock.note(estimate.publish_stamp_ns, monotonic_ns());
                }
                if is_new(estimate.publish_stamp_ns, &mut n_estimates) {
                    model.note(News::Estimate(estimate));
                }
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }
    let printed = match (&model.estimate, &model.status) {
        (Some(estimate), Some(status)) if json => {
            serde_json::to_string_pretty(&Document { estimate: EstimateLine::of(estimate), status })?
        }
        _ => text(&model, now(&model), TEXT_WIDTH),
    };
    writeln!(stdout(), "{printed}")?;
    Ok(())
}

/// Prints each estimate as a line of JSON, until `stop` or `count` lines.
///
/// # Errors
/// A service that will never fit; an output that is closed.
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
