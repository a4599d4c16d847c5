//! Measures how late a thread wakes up, with each real-time setting and without. The modes take turns, so that other load
//! on the machine affects all of them alike. Each turn is a new thread, since a thread's settings end with it.

use super::fact::Plan;
use crate::config::RealTimeConfig;
use crate::deadline::{skip_missed, wait_for_deadline};
use crate::latency::Latency;
use crate::system::real_time::stay_on_cores;
use crate::system::settings;
use serde::Serialize;
use shared_types::LatencySummary;
use shared_types::clock::monotonic_ns;

/// Turns into which the measurement of each mode is divided.
const TURNS: u32 = 4;

/// What the waiting thread asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Mode {
    Ordinary,
    PunctualTimers,
    Fifo,
    AwakeCores,
    LockedMemory,
    Everything,
    OrdinarySpin,
    EverythingSpin,
}

impl Mode {
    const ALL: [Self; 8] = [
        Self::Ordinary,
        Self::PunctualTimers,
        Self::Fifo,
        Self::AwakeCores,
        Self::LockedMemory,
        Self::Everything,
        Self::OrdinarySpin,
        Self::EverythingSpin,
    ];

    pub(crate) fn words(self, spin_us: f64, priority: u8) -> String {
        match self {
            Self::Ordinary => "ordinary thread".into(),
            Self::PunctualTimers => "with punctual timers".into(),
            Self::Fifo => format!("and SCHED_FIFO {priority}"),
            Self::AwakeCores => "punctual, cores kept awake".into(),
            Self::LockedMemory => "punctual, memory locked".into(),
            Self::Everything => "all of these".into(),
            Self::OrdinarySpin => format!("ordinary thread, spin {spin_us:.0} µs"),
            Self::EverythingSpin => format!("all of these, spin {spin_us:.0} µs"),
        }
    }

    fn spins(self) -> bool {
        matches!(self, Self::OrdinarySpin | Self::EverythingSpin)
    }

    fn asks_for_nothing(self) -> bool {
        matches!(self, Self::Ordinary | Self::OrdinarySpin)
    }

    fn asked(self, plan: &Plan) -> RealTimeConfig {
        let all = matches!(self, Self::Everything | Self::EverythingSpin);
        RealTimeConfig {
            priority: (all || self == Self::Fifo).then_some(plan.priority),
            cores: None,
            lock_memory: all || self == Self::LockedMemory,
            awake_cores: all || self == Self::AwakeCores,
            required: false,
        }
    }
}

/// One mode's figures.
#[derive(Debug, Serialize)]
pub(crate) struct LatenessRow {
    pub(crate) mode: Mode,
    /// Deadline to wake-up; `None` where the mode was refused.
    pub(crate) lateness_ns: Option<LatencySummary>,
    #[serde(skip_serializing_if = "Option::is_none")]
    /// Why it was refused.
    pub(crate) lateness_ns_reason: Option<String>,
}

fn wakes_per_turn(plan: &Plan) -> u32 {
    (plan.seconds * plan.rate_hz / f64::from(TURNS)).ceil() as u32
}

/// How long [`measure`] takes (s).
pub(crate) fn seconds(plan: &Plan) -> f64 {
    f64::from(wakes_per_turn(plan) * TURNS) / plan.rate_hz * Mode::ALL.len() as f64
}

/// Measures every mode.
pub(crate) fn measure(plan: &Plan) -> Vec<LatenessRow> {
    let mut found = Mode::ALL.map(|mode| (mode, Latency::new(), None::<String>));
    let n_wakes = wakes_per_turn(plan);
    for _ in 0..TURNS {
        for (mode, latency, refused) in &mut found {
            if refused.is_some() {
                continue;
            }
            let (mode, plan) = (*mode, plan.clone());
            let turn = std::thread::spawn(move || turn(mode, &plan, n_wakes)).join();
            match turn {
                Ok(Ok(lateness_ns)) => {
                    lateness_ns.into_iter().for_each(|late_ns| latency.note(Some(late_ns)))
                }
                Ok(Err(reason)) => *refused = Some(reason),
                Err(_) => *refused = Some("the measuring thread ended by itself".into()),
            }
        }
    }
    let row = |(mode, latency, refused): (Mode, Latency, Option<String>)| LatenessRow {
        mode,
        lateness_ns: refused.is_none().then(|| latency.summary()),
        lateness_ns_reason: refused,
    };
    found.into_iter().map(row).collect()
}

/// Lateness of each wake-up of one turn (ns), or why the mode cannot be measured.
fn turn(mode: Mode, plan: &Plan, n_wakes: u32) -> Result<Vec<u64>, String> {
    let mut held = settings::Held::default();
    if let Some(cores) = &plan.cores {
        // All modes on the cores that the loop would have.
        stay_on_cores(cores).map_err(|refused| refused.to_string())?;
    }
    if !mode.asks_for_nothing() {
        let (outcome, granted) = settings::apply(&mode.asked(plan));
        held = granted;
        if !outcome.refused.is_empty() {
            let refused: Vec<_> = outcome.refused.iter().map(|(_, refused)| refused.to_string()).collect();
            return Err(refused.join("; "));
        }
    }
    let spin_ns = if mode.spins() { (plan.spin_us * 1e3) as u64 } else { 0 };
    let period_ns = (1e9 / plan.rate_hz) as u64;
    // Touched, so that no page is mapped between two deadlines.
    let mut lateness_ns = vec![1; n_wakes as usize];
    let mut deadline_ns = monotonic_ns() + period_ns;
    for late_ns in &mut lateness_ns {
        *late_ns = wait_for_deadline(deadline_ns, spin_ns).wake_ns - deadline_ns;
        skip_missed(&mut deadline_ns, monotonic_ns(), period_ns);
    }
    drop(held);
    Ok(lateness_ns)
}
