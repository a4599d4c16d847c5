//! Stops and kills the publishing process, as faults.
//!
//! With such a fault `sim_publisher run` does not publish itself. It starts itself again as a *worker*, with the same
//! arguments, and sends the worker SIGSTOP, SIGCONT and SIGKILL at the faults' times. A worker that is started after a kill
//! gets the start time of the run. Since the simulation depends only on its options, the worker computes it up to the
//! present and publishes from there. Samples that were due while no worker ran are not sent.
//!
//! A worker writes to its stdout, as one JSON document per line, when it starts to publish and, at its end, what it did.

use crate::faults::{Fault, Kind, Reach};
use crate::publish::Published;
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};
use serde::{Deserialize, Serialize};
use shared_types::clock::monotonic_ns;
use std::ffi::OsString;
use std::io::{self, BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;

/// How often stop requests and workers are checked while nothing is due.
const LOOK_EVERY_NS: u64 = 5_000_000;

/// A message of a worker.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "worker")]
pub enum Message {
    /// It publishes from now on.
    Started {
        /// CLOCK_MONOTONIC of the run's start (ns).
        start_stamp_ns: u64,
        /// Samples that were due since the last worker died: they are not sent.
        samples_missed: u64,
    },
    /// It has ended.
    Ended {
        /// What it published.
        published: Published,
        /// How many samples each fault concerned, in the order of the faults.
        tallies: Vec<u64>,
    },
}

/// What a run of workers did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Supervised {
    /// What they published; lateness is that of the last one.
    pub published: Published,
    /// How many samples each fault concerned, in the order of the faults.
    pub tallies: Vec<u64>,
}

/// Why it failed.
#[derive(Debug, thiserror::Error)]
pub enum SuperviseError {
    /// A process cannot be started or signalled.
    #[error("{action} the publishing process: {error}")]
    Process {
        /// What was tried.
        action: &'static str,
        /// The system's reason.
        error: io::Error,
    },
    /// The worker failed; it has reported the reason itself.
    #[error("the publishing process ended early (exit code {0})")]
    Ended(i32),
}

fn failed<E: Into<io::Error>>(action: &'static str) -> impl FnOnce(E) -> SuperviseError {
    move |error| SuperviseError::Process { action, error: error.into() }
}

/// Whether a fault needs a supervisor.
pub fn is_needed(faults: &[Fault]) -> bool {
    faults.iter().any(|fault| matches!(fault.kind, Kind::Stop | Kind::Kill))
}

/// For the worker: it does not outlive its supervisor, stopped or not.
pub fn end_with_supervisor() {
    // Best effort: without it, a killed supervisor leaves a vehicle behind that publishes on.
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
}

fn nanoseconds(s: f64) -> u64 {
    (s * 1e9).round() as u64
}

/// What is done to a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// SIGSTOP.
    Stop,
    /// SIGCONT.
    GoOn,
    /// SIGKILL.
    Kill,
    /// It is started again.
    Start {
        /// After the kill of this fault.
        fault: usize,
    },
}

/// The actions of these faults on the source's or the service's process, in the order of their times after the run's start (ns).
pub fn steps(faults: &[Fault], process: Reach) -> Vec<(u64, Step)> {
    let mut steps = Vec::new();
    for (i, fault) in faults.iter().enumerate() {
        let (start_ns, end_ns) = (nanoseconds(fault.span.start_s), nanoseconds(fault.span.end_s()));
        if fault.kind.reach() != process {
            continue;
        }
        match fault.kind {
            Kind::Stop | Kind::ServiceStop => steps.extend([(start_ns, Step::Stop), (end_ns, Step::GoOn)]),
            Kind::Kill | Kind::ServiceKill => {
                steps.extend([(start_ns, Step::Kill), (end_ns, Step::Start { fault: i })]);
            }
            _ => {}
        }
    }
    // Stable; and of two at the same instant, what ends one fault comes before what begins the next.
    steps.sort_by_key(|&(at_ns, step)| (at_ns, matches!(step, Step::Stop | Step::Kill)));
    steps
}

/// Runs workers, each this program with `arguments` and what makes it a worker, until the last one ends or `stop` is set.
///
/// # Errors
/// A process cannot be started or signalled, or fails by itself.
pub fn supervise(
    arguments: &[OsString],
    faults: &[Fault],
    stop: &AtomicBool,
) -> Result<Supervised, SuperviseError> {
    let mut worker = Worker::start(arguments, None)?;
    let mut missed = vec![0; faults.len()];
    let mut start_ns = None;
    let mut steps = steps(faults, Reach::Source).into_iter().peekable();
    // The kill since which no process publishes, and when it was, after the run's start.
    let mut dead_since: Option<(usize, u64)> = None;
    let mut asked_to_end = false;
    let (mut published, mut tallies) = loop {
        match worker.messages.try_recv() {
            Ok(Message::Started { start_stamp_ns, samples_missed }) => {
                start_ns = Some(start_stamp_ns);
                if let Some((fault, _)) = dead_since.take() {
                    missed[fault] = samples_missed;
                }
                continue;
            }
            Ok(Message::Ended { published, tallies }) => break (published, tallies),
            // It was stopped before it could handle the signal: its counts are unknown.
            Err(TryRecvError::Disconnected) if asked_to_end => {
                break (Published { stopped: true, ..Published::default() }, missed.clone());
            }
            Err(TryRecvError::Disconnected) => {
                let status = worker.process.wait().map_err(failed("wait for"))?;
                return Err(SuperviseError::Ended(status.code().unwrap_or(1)));
            }
            Err(TryRecvError::Empty) => {}
        }
        if stop.load(Ordering::Relaxed) && !asked_to_end {
            worker.ask_to_end();
            (asked_to_end, steps) = (true, Vec::new().into_iter().peekable());
        }
        let now_ns = monotonic_ns();
        let next = start_ns.and_then(|start_ns| Some((start_ns, steps.peek()?.0 + start_ns)));
        match next {
            Some((start_ns, at_ns)) if at_ns <= now_ns => match steps.next().expect("it was peeked at").1 {
                Step::Stop => worker.signal(Signal::STOP),
                Step::GoOn => worker.signal(Signal::CONT),
                Step::Kill if worker.has_ended()? => {}
                // The next action starts another worker; until then no message arrives.
                Step::Kill => {
                    worker.process.kill().map_err(failed("kill"))?;
                    worker.process.wait().map_err(failed("wait for"))?;
                    let killed_ns = at_ns - start_ns;
                    let Some((at_ns, Step::Start { fault })) = steps.next() else {
                        unreachable!("a kill is followed by a start: faults of one process do not overlap")
                    };
                    while monotonic_ns() < start_ns + at_ns && !stop.load(Ordering::Relaxed) {
                        std::thread::sleep(Duration::from_nanos(LOOK_EVERY_NS));
                    }
                    let (_, since_ns) = *dead_since.get_or_insert((fault, killed_ns));
                    worker = Worker::start(arguments, Some((start_ns, since_ns)))?;
                }
                Step::Start { .. } => {}
            },
            next => {
                let until_next_ns = next.map_or(LOOK_EVERY_NS, |(_, at_ns)| at_ns - now_ns);
                std::thread::sleep(Duration::from_nanos(until_next_ns.min(LOOK_EVERY_NS)));
            }
        }
    };
    worker.process.wait().map_err(failed("wait for"))?;
    // The last worker went through the whole run: what it skipped, others had sent, but for what they missed.
    let missed_in_all: u64 = missed.iter().sum();
    published.samples_published += published.samples_skipped.saturating_sub(missed_in_all);
    published.samples_skipped = missed_in_all;
    for (i, fault) in faults.iter().enumerate() {
        if fault.kind == Kind::Kill {
            tallies[i] = missed[i];
        }
    }
    Ok(Supervised { published, tallies })
}

struct Worker {
    process: Child,
    messages: Receiver<Message>,
}

impl Worker {
    /// `resumed` is the start of the run that it continues, and since when after that no process published.
    fn start(arguments: &[OsString], resumed: Option<(u64, u64)>) -> Result<Self, SuperviseError> {
        let program = std::env::current_exe().map_err(failed("find the program of"))?;
        let mut command = Command::new(program);
        command.args(arguments).arg("--worker");
        if let Some((start_ns, dead_since_ns)) = resumed {
            command.arg("--resumed-start-ns").arg(start_ns.to_string());
            command.arg("--dead-since-ns").arg(dead_since_ns.to_string());
        }
        let mut process = command.stdout(Stdio::piped()).spawn().map_err(failed("start"))?;
        let output = BufReader::new(process.stdout.take().expect("it is piped"));
        let (send, messages) = channel();
        std::thread::spawn(move || {
            let lines = output.lines().map_while(Result::ok);
            for message in lines.filter_map(|line| serde_json::from_str(&line).ok()) {
                if send.send(message).is_err() {
                    break;
                }
            }
        });
        Ok(Self { process, messages })
    }

    fn signal(&self, signal: Signal) {
        // It may have ended already.
        let _ = kill_process(Pid::from_child(&self.process), signal);
    }

    /// As Ctrl-C does, stopped or not.
    fn ask_to_end(&self) {
        self.signal(Signal::TERM);
        self.signal(Signal::CONT);
    }

    fn has_ended(&mut self) -> Result<bool, SuperviseError> {
        Ok(self.process.try_wait().map_err(failed("look at"))?.is_some())
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if let Ok(None) = self.process.try_wait() {
            let _ = self.process.kill();
            let _ = self.process.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::read_faults;

    #[test]
    fn steps_are_in_the_order_of_time() {
        let faults =
            read_faults(&["kill@5:1; burst@1:1; stop@2:3; stop@6:0.5; service-stop@1:1".into()]).unwrap();
        let seconds: Vec<_> =
            steps(&faults, Reach::Source).into_iter().map(|(ns, step)| (ns as f64 * 1e-9, step)).collect();
        let expected = [
            (2.0, Step::Stop),
            (5.0, Step::GoOn),
            (5.0, Step::Kill),
            (6.0, Step::Start { fault: 0 }),
            (6.0, Step::Stop),
            (6.5, Step::GoOn),
        ];
        assert_eq!(seconds, expected);
        assert!(is_needed(&faults) && !is_needed(&faults[1..2]));
    }

    #[test]
    fn what_a_worker_says_is_understood() {
        for message in [
            Message::Started { start_stamp_ns: 7, samples_missed: 3 },
            Message::Ended { published: Published::default(), tallies: vec![1, 2] },
        ] {
            let line = serde_json::to_string(&message).unwrap();
            assert_eq!(serde_json::from_str::<Message>(&line).unwrap(), message);
        }
    }
}
