//! Notifications to the service manager (systemd, `Type=notify`): ready, alive, stopping, and a line of status.
//!
//! The housekeeping thread feeds the watchdog only if the loop's tick counter has advanced since the last time. A loop that
//! hangs is therefore killed and started again, although the housekeeping thread still runs. Without a service manager (no
//! `NOTIFY_SOCKET`) nothing is sent.

use sd_notify::NotifyState;
use shared_types::Status;
use std::time::{Duration, Instant};

/// How many times the watchdog is fed within its time limit.
const FEEDINGS_PER_TIMEOUT: u32 = 4;
const LINE_EVERY: Duration = Duration::from_secs(2);

fn tell(states: &[NotifyState<'_>]) {
    // A failure is ignored: a manager that gets no notification restarts the service.
    let _ = sd_notify::notify(states);
}

/// All services exist and the loop runs.
pub fn tell_ready() {
    tell(&[NotifyState::Ready]);
}

/// The service was asked to end.
pub fn tell_stopping() {
    tell(&[NotifyState::Stopping]);
}

/// The housekeeping thread's connection to the service manager.
#[derive(Debug)]
pub struct ServiceManager {
    watchdog: Option<Watchdog>,
    next_line: Option<Instant>,
}

impl ServiceManager {
    /// The service manager that started this process, if any.
    pub fn of_this_process() -> Self {
        let now = Instant::now();
        Self {
            watchdog: sd_notify::watchdog_enabled().map(|timeout| Watchdog::new(timeout, now)),
            next_line: std::env::var_os("NOTIFY_SOCKET").map(|_| now),
        }
    }

    /// Feeds the watchdog if it is time to, and the loop has ticked since the last time.
    pub fn feed_watchdog(&mut self, ticks: u64) {
        if let Some(watchdog) = &mut self.watchdog
            && watchdog.is_fed_by(ticks, Instant::now())
        {
            tell(&[NotifyState::Watchdog]);
        }
    }

    /// A line for `systemctl status`, now and then.
    pub fn describe(&mut self, status: &Status) {
        let now = Instant::now();
        if self.next_line.is_none_or(|next_line| now < next_line) {
            return;
        }
        self.next_line = Some(now + LINE_EVERY);
        let sample = match status.newest_sample_age_ns {
            u64::MAX => "no sample yet".into(),
            age_ns => format!("newest sample {:.2} s old", age_ns as f64 / 1e9),
        };
        tell(&[NotifyState::Status(&format!(
            "{} ticks, {} deadlines missed; {sample}",
            status.counters.ticks, status.counters.deadline_misses
        ))]);
    }
}

/// When the watchdog is fed.
#[derive(Debug)]
struct Watchdog {
    every: Duration,
    fed: Instant,
    ticks: u64,
}

impl Watchdog {
    fn new(timeout: Duration, now: Instant) -> Self {
        Self { every: timeout / FEEDINGS_PER_TIMEOUT, fed: now, ticks: 0 }
    }

    fn is_fed_by(&mut self, ticks: u64, now: Instant) -> bool {
        let feeds = ticks != self.ticks && now.duration_since(self.fed) >= self.every;
        if feeds {
            (self.fed, self.ticks) = (now, ticks);
        }
        feeds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_ticks_feed_the_watchdog_and_not_too_often() {
        let start = Instant::now();
        let mut watchdog = Watchdog::new(Duration::from_secs(4), start);
        let after = |seconds: f64| start + Duration::from_secs_f64(seconds);
        for (ticks, seconds, feeds) in [
            (0, 2.0, false), // no tick yet
            (1, 2.1, true),
            (9, 2.2, false), // just fed
            (9, 3.2, true),
            (9, 60.0, false), // the loop is stuck
            (10, 60.1, true),
        ] {
            assert_eq!(watchdog.is_fed_by(ticks, after(seconds)), feeds, "{ticks} ticks after {seconds} s");
        }
    }
}
