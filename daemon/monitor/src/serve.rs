//! `monitor serve`: the topics of a recording live, over Foxglove's WebSocket protocol.
//!
//! Every client that reaches the port can read everything and change nothing; there is no password and no encryption. A
//! viewer that is too slow loses the oldest messages.

use crate::link::{Announcer, LOOK_EVERY, Link, Whence};
use crate::topics::{Topics, WallClock};
use anyhow::Context as _;
use foxglove::Context;
use shared_types::{Domain, clock::monotonic_ns, logln, outln};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};

/// Serves until `stop`, or the end of the duration.
///
/// # Errors
/// An address that cannot be listened on; a service of another version.
pub fn serve(
    domain: &Domain,
    instance: &str,
    listen: SocketAddr,
    duration_s: Option<f64>,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let context = Context::new();
    let server = context
        .websocket_server()
        .name(format!("observer {instance} (monitor {})", env!("CARGO_PKG_VERSION")))
        .bind(listen.ip().to_string(), listen.port())
        .start_blocking()
        .with_context(|| format!("cannot listen on {listen}; needed: a free port, --listen IP:PORT"))?;
    let address = SocketAddr::new(listen.ip(), server.port());
    outln!("ws://{address}");
    logln!("monitor: instance '{instance}' on ws://{address}; in Foxglove: Open connection; Ctrl-C ends it");
    if !listen.ip().is_loopback() {
        logln!(
            "monitor: every client that reaches this address can read all of it: no password, no encryption"
        );
    }
    let mut topics = Topics::new(&context, instance, WallClock::now());
    let mut link =
        Link::new(domain.clone(), instance, Whence::ThisMachine, monotonic_ns()).with_measurements();
    let start_ns = monotonic_ns();
    let (mut viewers, mut announcer) = (0, Announcer::default());
    let mut looked = Ok(());
    while !stop.load(Ordering::Relaxed) && looked.is_ok() {
        let now_ns = monotonic_ns();
        if duration_s.is_some_and(|duration_s| (now_ns - start_ns) as f64 * 1e-9 >= duration_s) {
            break;
        }
        looked = link.look(now_ns, |news| {
            announcer.note(&news);
            topics.note(&news, monotonic_ns());
        });
        if viewers != server.client_count() {
            viewers = server.client_count();
            logln!("monitor: {viewers} viewers");
        }
        std::thread::sleep(LOOK_EVERY);
    }
    server.stop().wait_blocking();
    looked?;
    Ok(())
}
