//! The live view: one thread reads messages, another draws and handles keys.
//!
//! Neither thread waits for the other: a stopped terminal does not delay reading, and a silent service does not delay the
//! keys. Only changes are written to the terminal, a few times a second, so that a slow link suffices.

use crate::link::{Link, News, Whence};
use crate::model::Model;
use crate::view::draw::draw;
use crate::view::notes::{Now, verdict};
use crate::view::state::View;
use crate::view::status_words::Level;
use crate::view::theme::Theme;
use anyhow::Context;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use shared_types::clock::monotonic_ns;
use shared_types::payload::{command, outcome};
use shared_types::{Client, Domain};
use std::io::stdout;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, UNIX_EPOCH};

/// Between two looks at the shared memory.
const READ_EVERY: Duration = Duration::from_millis(10);
/// A signal is noticed at least this often.
const LISTEN_AT_MOST: Duration = Duration::from_millis(100);
/// After a key the picture may be drawn earlier than its rate says, but not more often than this.
const KEY_ECHO: Duration = Duration::from_millis(50);
/// From a signal to the end of the program, even if the terminal blocks.
const END_WITHIN: Duration = Duration::from_secs(1);
/// How long an answer is shown.
const MESSAGE_SHOWN: Duration = Duration::from_secs(8);
/// For the service to be found by a command, and to answer it: it may write to a slow disk.
const CONNECT_PATIENCE: Duration = Duration::from_millis(500);
const COMMAND_PATIENCE: Duration = Duration::from_secs(20);

/// The present, by the clock of the service's machine.
pub fn now(model: &Model) -> Now {
    let unix_s = UNIX_EPOCH.elapsed().map_or(0, |since| since.as_secs());
    Now { monotonic_ns: model.clock.at(monotonic_ns()), unix_s }
}

/// Shows `instance` until `q`, Ctrl-C or a signal, `fps` times a second at most.
///
/// # Errors
/// If the terminal refuses a setting, or was closed.
pub fn run(
    domain: &Domain,
    instance: &str,
    whence: Whence,
    fps: f64,
    theme: Theme,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<()> {
    let reader = Reader::start(domain.clone(), instance, whence, Arc::clone(stop));
    let mut terminal = ratatui::try_init().context("take over the terminal")?;
    let mut screen = Screen {
        domain: domain.clone(),
        whence,
        reader: &reader,
        view: View::new(theme),
        still: None,
        message_until: None,
        answer: None,
    };
    let done = screen.serve(&mut terminal, Duration::from_secs_f64(1.0 / fps), stop);
    ratatui::try_restore().context("give the terminal back")?;
    done
}

/// The thread that follows the service.
struct Reader {
    model: Arc<Mutex<Model>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Reader {
    /// Ends the program if it must end, after a signal or because the terminal was closed, and the drawing thread does not end:
    /// crossterm 0.29 does not return from a terminal that was closed (its issue 793), and a write to a terminal that
    /// accepts no more output blocks.
    fn start(domain: Domain, instance: &str, whence: Whence, signalled: Arc<AtomicBool>) -> Self {
        let model = Arc::new(Mutex::new(Model::new(instance)));
        let stop = Arc::new(AtomicBool::new(false));
        let (its_model, its_stop, instance) = (Arc::clone(&model), Arc::clone(&stop), instance.to_string());
        let follow = move || {
            let mut link = Link::new(domain, &instance, whence, monotonic_ns());
            let mut failing_since_ns = None;
            while !its_stop.load(Ordering::Relaxed) {
                if signalled.load(Ordering::Relaxed) || terminal_is_gone() {
                    signalled.store(true, Ordering::Relaxed);
                    drop(link);
                    let since = Instant::now();
                    while !its_stop.load(Ordering::Relaxed) {
                        if since.elapsed() > END_WITHIN {
                            std::process::exit(1);
                        }
                        std::thread::sleep(READ_EVERY);
                    }
                    return;
                }
                let now_ns = monotonic_ns();
                match link.look(now_ns, |news| lock(&its_model).note(news)) {
                    Ok(()) => failing_since_ns = None,
                    Err(error) => {
                        let since_ns = *failing_since_ns.get_or_insert(now_ns);
                        lock(&its_model).note(News::Away { since_ns, why: error.to_string() });
                    }
                }
                std::thread::sleep(READ_EVERY);
            }
        };
        Self { model, stop, thread: Some(std::thread::spawn(follow)) }
    }

    fn is_alive(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn terminal_is_gone() -> bool {
    let out = stdout();
    // HUP, ERR and NVAL are reported without being asked for.
    let mut asked = [PollFd::new(&out, PollFlags::empty())];
    let found = poll(&mut asked, Some(&Timespec::default()));
    found.is_ok() && asked[0].revents().intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL)
}

fn lock(model: &Mutex<Model>) -> MutexGuard<'_, Model> {
    model.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Screen<'a> {
    domain: Domain,
    whence: Whence,
    reader: &'a Reader,
    view: View,
    /// What is shown while paused.
    still: Option<(Model, Now)>,
    message_until: Option<Instant>,
    /// Of the command that is under way.
    answer: Option<mpsc::Receiver<(Level, String)>>,
}

impl Screen<'_> {
    fn serve(
        &mut self,
        terminal: &mut DefaultTerminal,
        period: Duration,
        stop: &AtomicBool,
    ) -> anyhow::Result<()> {
        let mut drawn = Instant::now();
        let mut due = drawn;
        while !stop.load(Ordering::Relaxed) {
            let wait = due.saturating_duration_since(Instant::now()).min(LISTEN_AT_MOST);
            if event::poll(wait).context("listen to the keys")? {
                let event = event::read().context("listen to the keys")?;
                if let Event::Key(key) = event
                    && key.kind == KeyEventKind::Press
                    && !self.obey(key)
                {
                    return Ok(());
                }
                due = due.min(drawn + KEY_ECHO);
            }
            self.take_answer();
            anyhow::ensure!(
                self.reader.is_alive() || stop.load(Ordering::Relaxed),
                "the reading thread has ended: a defect, please report it"
            );
            if Instant::now() >= due {
                self.draw(terminal)?;
                drawn = Instant::now();
                due = drawn + period;
            }
        }
        Ok(())
    }

    fn draw(&mut self, terminal: &mut DefaultTerminal) -> anyhow::Result<()> {
        let model = lock(&self.reader.model).clone();
        let now = now(&model);
        if let Some((still, at)) = &self.still {
            self.view.paused = Some(verdict(&model, now));
            terminal.draw(|frame| draw(frame, still, &self.view, *at)).context("draw")?;
        } else {
            self.view.paused = None;
            terminal.draw(|frame| draw(frame, &model, &self.view, now)).context("draw")?;
        }
        Ok(())
    }

    /// Handles a key; false to quit.
    fn obey(&mut self, key: KeyEvent) -> bool {
        if key.modifiers.contains(KeyModifiers::CONTROL) {
            return !matches!(key.code, KeyCode::Char('c' | 'd'));
        }
        if self.view.asks_reset {
            self.view.asks_reset = false;
            match key.code {
                KeyCode::Char('y' | 'Y') => self.command("reset", command::RESET),
                _ => self.say(Level::Info, "nothing was reset"),
            }
            return true;
        }
        if self.view.shows_help {
            self.view.shows_help = false;
            return true;
        }
        match key.code {
            KeyCode::Char('q') => return false,
            KeyCode::Char('?' | 'h') | KeyCode::F(1) => self.view.shows_help = true,
            KeyCode::Char('p' | ' ') => {
                self.still = match self.still.take() {
                    Some(_) => None,
                    None => {
                        let model = lock(&self.reader.model).clone();
                        let now = now(&model);
                        Some((model, now))
                    }
                };
            }
            KeyCode::Char('s') => self.command("save", command::SAVE),
            KeyCode::Char('f') if lock(&self.reader.model).is_frozen() => self.command("thaw", command::THAW),
            KeyCode::Char('f') => self.command("freeze", command::FREEZE),
            KeyCode::Char('r') => self.view.asks_reset = true,
            KeyCode::Tab => self.view.page = (self.view.page + 1) % 2,
            KeyCode::Char('1') => self.view.page = 0,
            KeyCode::Char('2') => self.view.page = 1,
            _ => {}
        }
        true
    }

    fn say(&mut self, level: Level, text: &str) {
        self.view.message = Some((level, text.into()));
        self.message_until = Some(Instant::now() + MESSAGE_SHOWN);
    }

    /// Sends a command from a thread of its own, so that the picture stays live.
    fn command(&mut self, name: &'static str, kind: u32) {
        if self.whence == Whence::AnotherMachine {
            self.say(Level::Caution, "no command crosses the link: on that machine, daemon control …");
            return;
        }
        if self.answer.is_some() {
            self.say(Level::Caution, "the command before is still under way");
            return;
        }
        let (answer, answered) = mpsc::channel();
        let (domain, instance) = (self.domain.clone(), lock(&self.reader.model).instance.clone());
        std::thread::spawn(move || {
            // The receiver is dropped only when the program ends.
            let _ = answer.send(carry_out(&domain, &instance, name, kind));
        });
        self.answer = Some(answered);
        self.say(Level::Info, &format!("{name} …"));
        self.message_until = None;
    }

    fn take_answer(&mut self) {
        match self.answer.as_ref().map(mpsc::Receiver::try_recv) {
            None | Some(Err(mpsc::TryRecvError::Empty)) => {}
            Some(answer) => {
                self.answer = None;
                let (level, text) = answer.unwrap_or((
                    Level::Alarm,
                    "the command's thread has ended: a defect, please report it".into(),
                ));
                self.say(level, &text);
            }
        }
        if self.message_until.is_some_and(|until| Instant::now() > until) {
            (self.view.message, self.message_until) = (None, None);
        }
    }
}

fn carry_out(domain: &Domain, instance: &str, name: &str, kind: u32) -> (Level, String) {
    let reply = Client::connect(domain, instance, CONNECT_PATIENCE)
        .and_then(|client| client.command(kind, COMMAND_PATIENCE));
    match reply {
        Ok(reply) if reply.outcome == outcome::DONE => (Level::Good, format!("{name}: {}", reply.text())),
        Ok(reply) => (Level::Alarm, format!("{name} refused: {}", reply.text())),
        Err(error) => (Level::Alarm, format!("{name}: {error}")),
    }
}
