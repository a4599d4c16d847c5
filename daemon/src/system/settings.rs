//! Applies the settings of `[real_time]` to the loop's thread. Refused settings are reported and left out.

use super::real_time::{
    self, AwakeCores, Refused, allowed_cores, keep_cores_awake, lock_memory, stay_on_cores, unlock_memory,
    use_fifo, use_punctual_timers,
};
use crate::config::RealTimeConfig;
use shared_types::payload::real_time as bits;

/// Stack that is touched before the first tick.
const STACK_RESERVE_BYTES: usize = 256 * 1024;
/// Heap that is touched before the first tick and stays with the process.
const HEAP_RESERVE_BYTES: usize = 1024 * 1024;
/// Blocks of the heap's reserve: below the 128 kB from which each would be a mapping of its own.
const HEAP_BLOCK_BYTES: usize = 32 * 1024;

/// What was requested from the system, and what it granted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Bits of [`shared_types::payload::real_time`].
    pub requested: u64,
    /// Those of them that were found to be so.
    pub granted: u64,
    /// What was read back of each granted one.
    pub found: Vec<String>,
    /// Each refused one: its bit, the reason, what would help.
    pub refused: Vec<(u64, Refused)>,
}

impl Outcome {
    fn note(&mut self, bit: u64, result: Result<String, Refused>) {
        self.requested |= bit;
        match result {
            Ok(found) => {
                self.granted |= bit;
                self.found.push(found);
            }
            Err(refused) => self.refused.push((bit, refused)),
        }
    }

    /// The refused settings and the system's reasons, in a few words: `priority (Operation not permitted …)`.
    pub fn refused_in_short(&self) -> String {
        let short = |(bit, refused): &(u64, Refused)| format!("{} ({})", bits::words(*bit)[0], refused.found);
        self.refused.iter().map(short).collect::<Vec<_>>().join(", ")
    }
}

/// What would help where a setting is refused, by its bit.
pub fn remedy(bit: u64) -> &'static str {
    match bit {
        bits::PRIORITY => real_time::FIFO_REMEDY,
        bits::CORES => real_time::CORES_REMEDY,
        bits::LOCKED_MEMORY => real_time::MEMORY_REMEDY,
        bits::PUNCTUAL_TIMERS => real_time::TIMERS_REMEDY,
        bits::AWAKE_CORES => real_time::AWAKE_REMEDY,
        _ => "",
    }
}

/// What holds for the whole process; it ends when this is dropped. The thread's own settings end with the thread.
#[derive(Debug, Default)]
pub struct Held {
    _awake: Option<AwakeCores>,
    memory_locked: bool,
}

impl Drop for Held {
    fn drop(&mut self) {
        if self.memory_locked {
            unlock_memory();
        }
    }
}

/// Applies the settings to the calling thread and its process; refused settings are left out. Call it after everything that
/// the thread will use has been made.
pub fn apply(asked: &RealTimeConfig) -> (Outcome, Held) {
    let (mut outcome, mut held) = (Outcome::default(), Held::default());
    // Before the priority: a thread with a fixed one has no slack that could be set.
    outcome.note(bits::PUNCTUAL_TIMERS, use_punctual_timers().map(|()| "timers without slack".into()));
    if let Some(cores) = &asked.cores {
        outcome.note(bits::CORES, stay_on_cores(cores).map(|()| format!("on cores {cores:?}")));
    }
    if asked.awake_cores {
        let awake = keep_cores_awake().map(|request| {
            held._awake = Some(request);
            "cores stay awake".into()
        });
        outcome.note(bits::AWAKE_CORES, awake);
    }
    if asked.lock_memory {
        let locked = lock_memory().map(|()| {
            held.memory_locked = true;
            "all memory locked".into()
        });
        outcome.note(bits::LOCKED_MEMORY, locked);
        touch_stack();
        reserve_heap();
    }
    // Last: nothing above need run before other threads.
    if let Some(priority) = asked.priority {
        outcome.note(
            bits::PRIORITY,
            use_fifo(priority).map(|()| format!("SCHED_FIFO with priority {priority}")),
        );
    }
    (outcome, held)
}

/// The outcome that [`apply`] would have; no setting stays in effect.
pub fn try_out(asked: &RealTimeConfig) -> Outcome {
    let asked = asked.clone();
    match std::thread::spawn(move || apply(&asked).0).join() {
        Ok(outcome) => outcome,
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// While it lives, the thread that made it is off the loop's cores, as are all that it has started meanwhile.
#[derive(Debug, Default)]
pub struct OffTheLoop {
    before: Vec<usize>,
}

impl OffTheLoop {
    /// Moves the calling thread off the loop's cores, if it may use others.
    ///
    /// # Errors
    /// `Refused` where the system does.
    pub fn of_calling_thread(asked: &RealTimeConfig) -> Result<Self, Refused> {
        let cores = asked.cores.as_deref().unwrap_or_default();
        let before = allowed_cores();
        let others: Vec<_> = before.iter().copied().filter(|core| !cores.contains(core)).collect();
        if others.is_empty() || others == before {
            return Ok(Self::default());
        }
        stay_on_cores(&others)?;
        Ok(Self { before })
    }
}

impl Drop for OffTheLoop {
    fn drop(&mut self) {
        if !self.before.is_empty() {
            // What was allowed before is allowed again, or the thread stays where it is.
            let _ = stay_on_cores(&self.before);
        }
    }
}

#[inline(never)]
fn touch_stack() {
    let mut reserve = [0_u8; STACK_RESERVE_BYTES];
    std::hint::black_box(&mut reserve);
}

/// Reserves mapped memory in the thread's heap.
///
/// glibc gives a large block back to the system when it is freed, and from then on keeps blocks of that size
/// (mallopt(3), "dynamic mmap threshold"); so the first block is there only to be freed.
fn reserve_heap() {
    let touched = |bytes: usize| {
        let mut block = vec![0_u8; bytes];
        block.iter_mut().step_by(1024).for_each(|byte| *byte = 1);
        std::hint::black_box(block)
    };
    drop(touched(HEAP_RESERVE_BYTES));
    let blocks: Vec<_> =
        (0..HEAP_RESERVE_BYTES / HEAP_BLOCK_BYTES).map(|_| touched(HEAP_BLOCK_BYTES)).collect();
    drop(blocks);
}

/// Whether the kernel interrupts what polls at a fixed priority, in words; `None` where it does not.
pub fn throttling() -> Option<String> {
    let read = |name: &str| -> Option<i64> {
        std::fs::read_to_string(format!("/proc/sys/kernel/{name}")).ok()?.trim().parse().ok()
    };
    let (runtime_us, period_us) = (read("sched_rt_runtime_us")?, read("sched_rt_period_us")?);
    (runtime_us >= 0 && runtime_us < period_us)
        .then(|| format!("sched_rt_runtime_us is {runtime_us} of {period_us} µs"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Locked memory is the whole process's: a test that counts page faults must not run beside it.
    static MEMORY: std::sync::Mutex<()> = std::sync::Mutex::new(());

    fn page_faults_of_this_thread() -> u64 {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        // The fields after the name, which may contain anything but ')'; minflt is the tenth of all.
        stat.rsplit_once(')').unwrap().1.split_whitespace().nth(7).unwrap().parse().unwrap()
    }

    fn faults_of_half_the_reserve() -> u64 {
        let before = page_faults_of_this_thread();
        let block = || std::hint::black_box(vec![1_u8; HEAP_BLOCK_BYTES]);
        let blocks: Vec<_> = (0..HEAP_RESERVE_BYTES / HEAP_BLOCK_BYTES / 2).map(|_| block()).collect();
        let faults = page_faults_of_this_thread() - before;
        drop(blocks);
        faults
    }

    #[test]
    fn memory_from_the_reserve_is_mapped_already() {
        let _alone = MEMORY.lock();
        let faults = |reserve: bool| {
            let measure = move || {
                if reserve {
                    reserve_heap();
                }
                faults_of_half_the_reserve()
            };
            std::thread::spawn(measure).join().unwrap()
        };
        let (without, with) = (faults(false), faults(true));
        // 512 kB are 128 pages; what other tests' threads left mapped is used again.
        assert!(without > with + 20 && with < 10, "{without} faults without the reserve, {with} with it");
    }

    #[test]
    fn what_is_granted_was_read_back_and_what_is_not_says_why() {
        let _alone = MEMORY.lock();
        let cores = allowed_cores();
        let asked = RealTimeConfig {
            priority: Some(10),
            cores: Some(vec![cores[0]]),
            lock_memory: true,
            awake_cores: true,
            required: false,
        };
        let outcome = try_out(&asked);
        assert_eq!(outcome.requested.count_ones(), 5);
        assert_eq!(outcome.found.len() + outcome.refused.len(), 5);
        let refused = outcome.refused.iter().fold(0, |sum, (bit, _)| sum | bit);
        assert_eq!(outcome.granted | refused, outcome.requested);
        assert_eq!(outcome.granted & refused, 0);
        for (bit, refused) in &outcome.refused {
            assert_eq!(refused.remedy, remedy(*bit), "{refused}");
        }
        assert_eq!(outcome.granted & bits::CORES, bits::CORES);
        // Nothing of it stays.
        assert_eq!(allowed_cores(), cores);
    }

    #[test]
    fn a_core_that_is_silently_left_out_is_a_refusal() {
        let cores = allowed_cores();
        let beyond = cores.last().unwrap() + 1;
        let asked = RealTimeConfig { cores: Some(vec![cores[0], beyond]), ..RealTimeConfig::default() };
        let outcome = try_out(&asked);
        let [(bits::CORES, refused)] = outcome.refused.as_slice() else { panic!("{outcome:?}") };
        assert!(refused.found.contains("were given"), "{refused}");
        assert!(outcome.refused_in_short().starts_with("cores ("), "{}", outcome.refused_in_short());
    }

    #[test]
    fn helpers_leave_the_loop_its_cores() {
        std::thread::spawn(|| {
            let cores = allowed_cores();
            let asked = RealTimeConfig { cores: Some(vec![cores[0]]), ..RealTimeConfig::default() };
            let off = OffTheLoop::of_calling_thread(&asked).unwrap();
            let expected = if cores.len() == 1 { &cores[..] } else { &cores[1..] };
            assert_eq!(allowed_cores(), expected);
            assert_eq!(std::thread::spawn(allowed_cores).join().unwrap(), expected);
            drop(off);
            assert_eq!(allowed_cores(), cores);
        })
        .join()
        .unwrap();
    }
}
