//! Runs the command and checks its output.

use std::{
    io::Read,
    process::{Child, Stdio},
    time::{Duration, Instant},
};
pub(crate) use std::{
    path::Path,
    process::{Command, Output},
};

/// Exit code and output of a run.
pub(crate) struct Run {
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Run {
    /// The output as JSON; for runs with `--json`.
    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {}\n{}", self.out, self.err))
    }

    pub(crate) fn ok(self) -> Self {
        assert_eq!(self.code, 0, "{}{}", self.out, self.err);
        self
    }

    /// The message of a run that must fail with exit code 1, naming all of these.
    pub(crate) fn fails(self, words: &[&str]) -> String {
        assert_eq!(self.code, 1, "{}{}", self.out, self.err);
        assert!(!self.err.contains("panicked"), "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "`{word}` is missing from: {}", self.err);
        }
        self.err
    }
}

/// Runs `fleetfoot` in a folder.
pub(crate) fn fleetfoot(folder: &Path, arguments: &[&str]) -> Run {
    let Output { status, stdout, stderr } = Command::new(env!("CARGO_BIN_EXE_fleetfoot"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("the command runs");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    Run { code: status.code().unwrap_or(-1), out: text(stdout), err: text(stderr) }
}

/// Runs `fleetfoot` in a folder; a run that takes longer is killed, which is a failure.
pub(crate) fn fleetfoot_within(folder: &Path, arguments: &[&str], limit: Duration) -> Run {
    Running::start(folder, arguments).end(limit)
}

/// `fleetfoot` under way.
pub(crate) struct Running {
    child: Child,
    command: String,
}

impl Running {
    pub(crate) fn start(folder: &Path, arguments: &[&str]) -> Self {
        // A test that `nohup` began hands an ignored hangup on to its children.
        let mut command = if cfg!(target_os = "linux") {
            let mut command = Command::new("env");
            command.args(["--default-signal=HUP", env!("CARGO_BIN_EXE_fleetfoot")]);
            command
        } else {
            Command::new(env!("CARGO_BIN_EXE_fleetfoot"))
        };
        let child = command.current_dir(folder).args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        Self { child: child.expect("the command runs"), command: arguments.join(" ") }
    }

    /// Waits until the command answers to signals: on a loaded machine its start may take longer than a test waits.
    #[cfg(unix)]
    fn until_it_listens(&self) {
        const TERM: u64 = 1 << 14;
        let listens = || {
            let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
            let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"))?;
            Some(u64::from_str_radix(caught.trim(), 16).ok()? & TERM != 0)
        };
        // Without such a file, the test is assumed to have waited for long enough.
        let begin = Instant::now();
        while listens() == Some(false) && begin.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Sends a signal, by its name.
    #[cfg(unix)]
    pub(crate) fn signal(&self, name: &str) {
        if name != "KILL" {
            self.until_it_listens();
        }
        let sent = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
        assert!(sent.expect("kill runs").success(), "{} is there no more", self.command);
    }

    /// Returns true if it has ended by itself.
    pub(crate) fn has_ended(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_some()
    }

    /// Waits for its end.
    pub(crate) fn end(mut self, limit: Duration) -> Run {
        let read = |pipe: Option<Box<dyn Read + Send>>| {
            std::thread::spawn(move || {
                let mut text = String::new();
                pipe.map(|mut pipe| pipe.read_to_string(&mut text).expect("UTF-8"));
                text
            })
        };
        let out = read(self.child.stdout.take().map(|pipe| Box::new(pipe) as _));
        let err = read(self.child.stderr.take().map(|pipe| Box::new(pipe) as _));
        let begin = Instant::now();
        while !self.has_ended() {
            if begin.elapsed() > limit {
                self.child.kill().expect("it is there");
                panic!("{}: not done after {limit:?}", self.command);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let code = self.child.wait().expect("a child").code().unwrap_or(-1);
        Run { code, out: out.join().expect("a reader"), err: err.join().expect("a reader") }
    }
}

/// Two files have the same bytes.
#[track_caller]
pub(crate) fn same(folder: &Path, a: &str, b: &str) {
    let read = |name: &str| std::fs::read(folder.join(name)).expect("a file");
    assert!(read(a) == read(b), "{a} and {b} differ");
}

/// A robot's log as CSV: `t, x, v, u, mode`. v' = -2 v + 3 u below v = 0.5 and -5 v + 2 u + 1 above, exact steps of
/// `dt`.
pub(crate) fn robot_csv(rows: usize, phase: f64) -> String {
    let dt = 0.01;
    let (mut x, mut v) = (0.0f64, 0.0f64);
    let mut text = String::from("t,x,v [m/s],u,mode,dv\n");
    for row in 0..rows {
        let t = row as f64 * dt;
        let u = 0.5 + 0.6 * (1.3 * t + phase).sin() + 0.4 * (0.7 * t * t.sqrt() + 2.0 * phase).cos();
        let slip = v > 0.5;
        let dv = if slip { -5.0 * v + 2.0 * u + 1.0 } else { -2.0 * v + 3.0 * u };
        text.push_str(&format!("{t},{x},{v},{u},{},{dv}\n", if slip { "slip" } else { "grip" }));
        x += dt * v;
        v += dt * dv;
    }
    text
}
