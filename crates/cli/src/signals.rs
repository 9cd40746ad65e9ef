//! Signals that stop the work: Ctrl-C, and what containers, schedulers and closed terminals send.

use std::{
    sync::OnceLock,
    time::{Duration, Instant},
};

use fleetfoot::data::Stop;

/// The exit code of work that was stopped.
pub(crate) const STOPPED: u8 = 130;

/// A second Ctrl-C within this time is the same one: tools send it to the process and to its group.
const ONE_PRESS: Duration = Duration::from_millis(100);

/// The stop of the command's work.
pub(crate) fn stop() -> &'static Stop {
    static STOP: OnceLock<Stop> = OnceLock::new();
    STOP.get_or_init(Stop::default)
}

/// The first SIGINT (Ctrl-C), SIGTERM or SIGHUP stops the work at its next checkpoint, so that no half-written file stays behind; a second SIGINT ends the process. A SIGHUP that
/// whoever began the process ignores (`nohup`) is ignored.
#[cfg(unix)]
pub(crate) fn stop_on_signals() {
    use signal_hook::{
        consts::{SIGHUP, SIGINT, SIGTERM},
        iterator::Signals,
    };
    let wanted = [Some(SIGINT), Some(SIGTERM), Some(SIGHUP).filter(|&signal| !is_ignored(signal))];
    // Without a handler, signals end the process as usual.
    let Ok(mut signals) = Signals::new(wanted.into_iter().flatten()) else { return };
    let wait = move || {
        let mut first: Option<Instant> = None;
        for signal in signals.forever() {
            stop().set();
            let before = *first.get_or_insert_with(Instant::now);
            if signal == SIGINT && before.elapsed() > ONE_PRESS {
                std::process::exit(STOPPED.into());
            }
        }
    };
    let _ = std::thread::Builder::new().name("signals".into()).spawn(wait);
}

/// True if the process inherited this signal as ignored.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let mut present = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action the call only writes the present one, into memory of its size; all zeros are a valid value of it.
    let present = unsafe {
        if libc::sigaction(signal, std::ptr::null(), present.as_mut_ptr()) != 0 {
            return false;
        }
        present.assume_init()
    };
    present.sa_sigaction == libc::SIG_IGN
}

/// The first Ctrl-C stops the work at its next checkpoint, so that no half-written file stays behind; the second ends the process.
#[cfg(not(unix))]
pub(crate) fn stop_on_signals() {
    let mut first: Option<Instant> = None;
    let _ = ctrlc::set_handler(move || {
        stop().set();
        if first.get_or_insert_with(Instant::now).elapsed() > ONE_PRESS {
            std::process::exit(STOPPED.into());
        }
    });
}
