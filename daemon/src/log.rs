//! The service's log: lines on stderr.

/// Writes a line to the log. An error on stderr is ignored: the service runs with or without a reader.
macro_rules! say {
    ($($argument:tt)*) => { shared_types::logln!("daemon: {}", format_args!($($argument)*)) };
}
pub(crate) use say;
