//! The vehicle's side for C and C++: [`shared_types::Client`] behind functions that C can call.
//!
//! `include/observer_client.h` is made from this file and from the tables of `shared_types::payload`; a test fails where
//! the checked-in one differs (`tests/generated`). `include/observer_client.hpp` wraps it for C++17.
//!
//! A handle is not a pointer: each call looks it up in a table of the calling thread. A handle that was closed, or that
//! another thread opened, is therefore refused after one comparison, and no call dereferences a dangling pointer. Ports
//! belong to the thread that made them and are closed when it ends.
//!
//! Depends on `shared_types` alone.

// Functions that C finds by name, and what their callers' pointers point to: there is no other way.
#![allow(unsafe_code)]

use shared_types::client::{Latest, MeasurementPublisher, Stream};
use shared_types::payload::Reply;
use shared_types::service::ServiceError;
use shared_types::{Client, ClientError, Domain, Estimate, Measurement, Status, clock};
use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub mod layout;

/// How a call ended: 0 and above are good, below are failures, whose reason observer_error_text() tells.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CallResult {
    /// Done.
    Ok = 0,
    /// No failure, but there is nothing: nothing to take, nothing published yet, no reader.
    Nothing = 1,
    /// An argument cannot be: null, not aligned, no text, not finite, another header, a port not asked for.
    BadArgument = -1,
    /// The handle is not open: never was, or was closed.
    BadHandle = -2,
    /// Another thread opened the handle. A handle is used, and closed, by the thread that opened it.
    WrongThread = -3,
    /// No service of that instance was there within the patience.
    NoDaemon = -4,
    /// The service did not answer within the patience.
    TimedOut = -5,
    /// What is there does not fit: another version of a payload or of iceoryx2, other qualities, another user's.
    Refused = -6,
    /// A port did not do it; the text has iceoryx2's reason.
    Port = -7,
    /// A defect of this library. Nothing is known of the handle's state: close it.
    Internal = -8,
}

/// A connection to one instance of the service, of the thread that opened it. All zero is none.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Handle {
    /// For the library.
    pub thread: u32,
    /// For the library.
    pub number: u32,
}

shared_types::constants! {
    /// What a handle is opened for: bits of `ports` in observer_open().
    pub mod ports: u32 {
        /// observer_publish(): a source. An instance has 8 places for sources.
        PUBLISH = 1 << 0;
        /// observer_take() and observer_wait(): a queue of 256 estimates. An instance has 32 places for readers of estimates.
        TAKE = 1 << 1;
        /// observer_peek(): the newest estimate. It takes a place for a reader of estimates, too.
        PEEK = 1 << 2;
        /// observer_read_status(): the newest status. An instance has 32 places for readers of it.
        STATUS = 1 << 3;
        /// All of these.
        ALL = (1 << 4) - 1;
    }
}

/// A failed call: the result for C, and the text of the error.
struct Failure {
    result: CallResult,
    text: String,
}

impl Failure {
    fn argument(text: impl Into<String>) -> Self {
        Self { result: CallResult::BadArgument, text: text.into() }
    }
}

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        let result = match &error {
            ClientError::Service(ServiceError::InstanceName(_)) => CallResult::BadArgument,
            ClientError::Service(_) => CallResult::Refused,
            ClientError::NoDaemon { .. } => CallResult::NoDaemon,
            ClientError::TimedOut { .. } => CallResult::TimedOut,
            ClientError::Port { .. } => CallResult::Port,
        };
        Self { result, text: error.to_string() }
    }
}

struct Connection {
    handle: Handle,
    measurements: Option<MeasurementPublisher>,
    estimates: Option<Stream<Estimate>>,
    newest_estimate: Option<Latest<Estimate>>,
    newest_status: Option<Latest<Status>>,
    client: Client,
}

/// What one thread has opened.
struct Opened {
    process: u32,
    thread: u32,
    last_number: u32,
    connections: Vec<Connection>,
}

impl Drop for Opened {
    /// In a forked child the ports belong to the parent, which still uses them: they are not closed.
    fn drop(&mut self) {
        if self.process != std::process::id() {
            std::mem::forget(std::mem::take(&mut self.connections));
        }
    }
}

static THREADS: AtomicU32 = AtomicU32::new(0);

thread_local! {
    static OPENED: RefCell<Opened> = RefCell::new(Opened {
        process: std::process::id(),
        thread: THREADS.fetch_add(1, Ordering::Relaxed) + 1,
        last_number: 0,
        connections: Vec::new(),
    });
    static ERROR_TEXT: RefCell<CString> = RefCell::default();
}

/// Runs a call: a failure's text is kept for this thread, and no panic leaves the library.
fn guarded(call: impl FnOnce() -> Result<CallResult, Failure>) -> CallResult {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(result)) => result,
        Ok(Err(failure)) => failed(failure),
        Err(panic) => failed(Failure { result: CallResult::Internal, text: words_of(&*panic) }),
    }
}

#[cold]
fn failed(Failure { result, text }: Failure) -> CallResult {
    let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
    // A thread that is ending cannot store it any more.
    let _ = ERROR_TEXT.try_with(|kept| kept.replace(text));
    result
}

fn words_of(panic: &(dyn Any + Send)) -> String {
    let words = panic.downcast_ref::<String>().map(String::as_str);
    let words = words.or(panic.downcast_ref::<&str>().copied()).unwrap_or("no words");
    format!("a defect of the library: {words}; close the handle, and please report it")
}

/// The connections of this thread, to change them.
fn opened<T>(change: impl FnOnce(&mut Opened) -> Result<T, Failure>) -> Result<T, Failure> {
    let misused = |text: &str| Failure { result: CallResult::BadHandle, text: text.into() };
    let found = OPENED.try_with(|opened| match opened.try_borrow_mut() {
        Ok(mut opened) => change(&mut opened),
        Err(_) => Err(misused("called within another call: a signal handler must not use the library")),
    });
    found.unwrap_or_else(|_| Err(misused("the thread is ending, its handles are closed already")))
}

#[cold]
fn not_open(handle: Handle, thread: u32) -> Failure {
    let elsewhere = handle.thread != thread && (1..=THREADS.load(Ordering::Relaxed)).contains(&handle.thread);
    let (result, text) = match (handle, elsewhere) {
        (Handle { thread: 0, .. }, _) => (CallResult::BadHandle, "the handle was never opened"),
        (_, true) => (
            CallResult::WrongThread,
            "another thread opened this handle: ports do not change threads; open one on this thread",
        ),
        _ => (
            CallResult::BadHandle,
            "the handle is not open: it was closed already, or its bytes were overwritten",
        ),
    };
    Failure { result, text: text.into() }
}

/// The connection behind a handle.
fn with<T>(handle: Handle, act: impl FnOnce(&mut Connection) -> Result<T, Failure>) -> Result<T, Failure> {
    opened(|opened| match opened.connections.iter_mut().find(|connection| connection.handle == handle) {
        Some(connection) => act(connection),
        None => Err(not_open(handle, opened.thread)),
    })
}

/// A port, where the handle was opened for it.
fn port<'a, T>(port: &'a mut Option<T>, bit: &str) -> Result<&'a mut T, Failure> {
    port.as_mut()
        .ok_or_else(|| Failure::argument(format!("the handle was opened without {bit} among its ports")))
}

fn usable<T>(pointer: *const T, name: &str) -> Result<(), Failure> {
    match pointer {
        _ if pointer.is_null() => Err(Failure::argument(format!("{name} is null"))),
        _ if !pointer.is_aligned() => {
            Err(Failure::argument(format!("{name} is not aligned to {} bytes", align_of::<T>())))
        }
        _ => Ok(()),
    }
}

/// What the caller lends.
///
/// # Safety
/// `pointer`, if neither null nor misaligned, points to a value that no thread changes during the call.
unsafe fn input<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Failure> {
    usable(pointer, name)?;
    // SAFETY: neither null nor misaligned; the rest is the caller's promise.
    Ok(unsafe { &*pointer })
}

/// The caller's memory for a result; its present contents may be anything.
///
/// # Safety
/// `pointer`, if neither null nor misaligned, points to memory of a `T` that nothing else uses during the call.
unsafe fn output<'a, T>(pointer: *mut T, name: &str) -> Result<&'a mut MaybeUninit<T>, Failure> {
    usable(pointer, name)?;
    // SAFETY: neither null nor misaligned; the rest is the caller's promise. No value is assumed to be there.
    Ok(unsafe { &mut *pointer.cast::<MaybeUninit<T>>() })
}

/// # Safety
/// `pointer`, if not null, points to text that ends with a zero.
unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    usable(pointer, name)?;
    // SAFETY: not null; the rest is the caller's promise.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Failure::argument(format!("{name} is not UTF-8")))
}

fn patience(seconds: f64) -> Result<Duration, Failure> {
    // Deadlines are counted in nanoseconds of 64 bits.
    match Duration::try_from_secs_f64(seconds) {
        Ok(patience) if seconds <= 1e9 => Ok(patience),
        _ => Err(Failure::argument(format!("patience_s is {seconds}; needed: 0 to 1e9 s"))),
    }
}

fn found<T>(value: Option<T>) -> CallResult {
    value.map_or(CallResult::Nothing, |_| CallResult::Ok)
}

/// Connects this thread to the service of an instance, and opens the ports that are asked for: what allocates
/// and asks the system happens here. Waits up to `patience_s` for the service to start.
///
/// `layout`: OBSERVER_LAYOUT, which tells whether program and library have the same payloads.
/// `root_path`: the domain's, absolute; null for $OBSERVER_ROOT or, without it, the user's own.
/// `instance`: the vehicle's name, usually "vehicle".
/// `ports`: bits of OBSERVER_PORTS_….
/// `patience_s`: 0 to 1e9 s.
/// `client`: where the handle goes; all zero after a failure.
///
/// # Safety
/// The texts end with a zero; `client` points to a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_open(
    layout: u32,
    root_path: *const c_char,
    instance: *const c_char,
    ports: u32,
    patience_s: f64,
    client: *mut Handle,
) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let place = unsafe { output(client, "client") }?;
        place.write(Handle { thread: 0, number: 0 });
        if layout != layout::HASH {
            return Err(Failure::argument(format!(
                "the program has the payloads of layout {layout:#010x}, the library those of {:#010x}; compile the program with this library's observer_client.h, and pass OBSERVER_LAYOUT",
                layout::HASH
            )));
        }
        if ports == 0 || ports & !ports::ALL != 0 {
            return Err(Failure::argument(format!("ports is {ports:#x}; needed: some of OBSERVER_PORTS_…")));
        }
        let domain = match root_path.is_null() {
            true => Domain::of_user(),
            // SAFETY: this function's own condition.
            false => Domain::at(Path::new(unsafe { text(root_path, "root_path") }?)),
        };
        let domain = domain.map_err(ClientError::from)?;
        // SAFETY: this function's own condition.
        let instance = unsafe { text(instance, "instance") }?;
        let client = Client::connect(&domain, instance, patience(patience_s)?)?;
        let asked = |bit| (ports & bit != 0).then_some(());
        let measurements = asked(ports::PUBLISH).map(|()| client.measurement_publisher()).transpose()?;
        let estimates = asked(ports::TAKE).map(|()| client.estimate_subscriber()).transpose()?;
        let newest_estimate = asked(ports::PEEK).map(|()| client.latest_estimate()).transpose()?;
        let newest_status = asked(ports::STATUS).map(|()| client.latest_status()).transpose()?;
        opened(|opened| {
            opened.last_number += 1;
            let handle = Handle { thread: opened.thread, number: opened.last_number };
            opened.connections.push(Connection {
                handle,
                measurements,
                estimates,
                newest_estimate,
                newest_status,
                client,
            });
            place.write(handle);
            Ok(CallResult::Ok)
        })
    })
}

/// Publishes one measurement; its sequence and its stamp (observer_now_ns()) are the caller's. Never blocks: where
/// the service is slow, the oldest sample is dropped. OBSERVER_NOTHING: no service is connected now.
///
/// No system call; one allocation, of iceoryx2 (48 bytes, freed before the call returns).
///
/// # Safety
/// `measurement` points to one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_publish(client: Handle, measurement: *const Measurement) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let measurement = unsafe { input(measurement, "measurement") }?;
        with(client, |connection| {
            let readers =
                port(&mut connection.measurements, "OBSERVER_PORTS_PUBLISH")?.publish(measurement)?;
            Ok(if readers == 0 { CallResult::Nothing } else { CallResult::Ok })
        })
    })
}

/// Takes the oldest estimate not yet taken; OBSERVER_NOTHING leaves `estimate` as it is. Where the reader is slow,
/// the oldest are dropped, which shows as a gap in their sequence. No system call, no allocation.
///
/// # Safety
/// `estimate` points to one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_take(client: Handle, estimate: *mut Estimate) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let place = unsafe { output(estimate, "estimate") }?;
        with(client, |connection| {
            let estimates = port(&mut connection.estimates, "OBSERVER_PORTS_TAKE")?;
            Ok(found(estimates.take_by(|estimate| _ = place.write(*estimate))?))
        })
    })
}

/// As observer_take(), but waits up to `patience_s` for an estimate, and looks every 50 µs (sleeping in between);
/// OBSERVER_TIMED_OUT if none came.
///
/// # Safety
/// `estimate` points to one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_wait(
    client: Handle,
    patience_s: f64,
    estimate: *mut Estimate,
) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let place = unsafe { output(estimate, "estimate") }?;
        let patience = patience(patience_s)?;
        with(client, |connection| {
            place.write(port(&mut connection.estimates, "OBSERVER_PORTS_TAKE")?.wait_next(patience)?);
            Ok(CallResult::Ok)
        })
    })
}

/// The newest estimate, taken or not; OBSERVER_NOTHING before the first leaves `estimate` as it is. When the
/// service dies the last one stays: its age is in its stamps. No system call, no allocation.
///
/// # Safety
/// `estimate` points to one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_peek(client: Handle, estimate: *mut Estimate) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let place = unsafe { output(estimate, "estimate") }?;
        with(client, |connection| {
            let newest = port(&mut connection.newest_estimate, "OBSERVER_PORTS_PEEK")?.newest()?;
            Ok(found(newest.map(|estimate| _ = place.write(*estimate))))
        })
    })
}

/// The newest status, which the service publishes a few times a second; OBSERVER_NOTHING before the first leaves
/// `status` as it is. No system call, no allocation.
///
/// # Safety
/// `status` points to one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_read_status(client: Handle, status: *mut Status) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let place = unsafe { output(status, "status") }?;
        with(client, |connection| {
            let newest = port(&mut connection.newest_status, "OBSERVER_PORTS_STATUS")?.newest()?;
            Ok(found(newest.map(|status| _ = place.write(*status))))
        })
    })
}

/// Sends a command (one of OBSERVER_COMMAND_…) and waits up to `patience_s` for the answer. OBSERVER_OK means that
/// there is one: its `outcome` says whether the command was carried out, observer_reply_text() what the service
/// says. Where the service is away, it is waited for as long as observer_open() was to. Allocates and asks the
/// system: not for the loop.
///
/// # Safety
/// `reply` points to one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_command(
    client: Handle,
    command: u32,
    patience_s: f64,
    reply: *mut Reply,
) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let place = unsafe { output(reply, "reply") }?;
        let patience = patience(patience_s)?;
        with(client, |connection| {
            place.write(connection.client.command(command, patience)?);
            Ok(CallResult::Ok)
        })
    })
}

/// Copies the text of a reply, with a zero at its end, cut where `text_bytes` are too few; OBSERVER_REPLY_TEXT_BYTES
/// are enough.
///
/// # Safety
/// `reply` points to one, `text` to `text_bytes` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer_reply_text(
    reply: *const Reply,
    text: *mut c_char,
    text_bytes: usize,
) -> CallResult {
    guarded(|| {
        // SAFETY: this function's own condition.
        let reply = unsafe { input(reply, "reply") }?;
        usable(text, "text")?;
        if text_bytes == 0 {
            return Err(Failure::argument("text_bytes is 0; needed: OBSERVER_REPLY_TEXT_BYTES"));
        }
        let words = reply.text();
        let end = words.floor_char_boundary(text_bytes - 1);
        // SAFETY: not null; `end` is below `text_bytes`, and both are this function's own condition.
        unsafe {
            text.copy_from_nonoverlapping(words.as_ptr().cast(), end);
            text.add(end).write(0);
        }
        Ok(CallResult::Ok)
    })
}

/// Closes a handle, on the thread that opened it. What a thread leaves open is closed when it ends.
#[unsafe(no_mangle)]
pub extern "C" fn observer_close(client: Handle) -> CallResult {
    guarded(|| {
        let closed = opened(|opened| {
            let found = opened.connections.iter().position(|connection| connection.handle == client);
            found
                .map(|index| opened.connections.swap_remove(index))
                .ok_or_else(|| not_open(client, opened.thread))
        })?;
        drop(closed);
        Ok(CallResult::Ok)
    })
}

/// Nanoseconds of CLOCK_MONOTONIC, the clock of every stamp. No system call where the kernel offers the vDSO.
#[unsafe(no_mangle)]
pub extern "C" fn observer_now_ns() -> u64 {
    clock::monotonic_ns()
}

/// What was found, needed, and what to do, of this thread's latest failure; empty before the first. Never null; valid until this
/// thread's next failure.
#[unsafe(no_mangle)]
pub extern "C" fn observer_error_text() -> *const c_char {
    ERROR_TEXT.try_with(|text| text.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_stays_inside_and_is_told() {
        assert_eq!(guarded(|| panic!("{} of {}", 3, 2)), CallResult::Internal);
        // SAFETY: never null, ends with a zero, valid until this thread's next failure.
        let text = unsafe { CStr::from_ptr(observer_error_text()) }.to_str().unwrap();
        assert!(text.contains("defect of the library: 3 of 2"), "{text}");
        // Open handles stay open after a panic.
        assert_eq!(observer_close(Handle { thread: 0, number: 0 }), CallResult::BadHandle);
    }
}
