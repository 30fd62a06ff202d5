//! Runs a headless Chromium for tests of a page.
//!
//! Chromium is controlled by its [DevTools protocol](https://chromedevtools.github.io/devtools-protocol/) over two
//! pipes (`--remote-debugging-pipe`): JSON, each message ended by a zero byte. No port is opened, and Chromium ends
//! with the pipes. The libraries `headless_chrome` and `chromiumoxide` would bring 141 and 150 crates for the dozen
//! commands that are used here.
//!
//! Chromium resolves no host name except this machine's, so a page's request to another machine fails and shows in
//! [`Tab::requests`].

#![forbid(unsafe_code)]

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};

const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

const PATIENCE: Duration = Duration::from_secs(60);

const LOOK: Duration = Duration::from_millis(10);

/// Returns the browser's program: the one that the environment variable `CHROMIUM` names, or else the first of the
/// known programs that is found. If there is none, prints a message and returns `None`.
///
/// # Panics
///
/// Panics if there is no browser and the environment has `CI`, where a browser must be installed.
#[must_use]
pub fn program() -> Option<PathBuf> {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let found = NAMES.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    let program = named.or_else(|| found.into_iter().find(|program| program.is_file()));
    if program.is_none() {
        let text = "there is no browser: install Debian's package chromium, or say where one is in CHROMIUM";
        assert!(std::env::var_os("CI").is_none(), "{text}");
        eprintln!("not run: {text}");
    }
    program
}

/// The size of the window in which a browser displays the page.
#[derive(Clone, Copy, Debug)]
pub struct Screen {
    /// The width of the page, CSS pixels.
    pub width: u32,
    /// The height of the page, CSS pixels.
    pub height: u32,
    /// The number of the screen's pixels for each CSS pixel, in each direction.
    pub scale: u32,
    /// Whether the screen is a phone's.
    pub phone: bool,
}

/// The screen of a computer on a desk.
pub const DESK: Screen = Screen { width: 1_280, height: 900, scale: 1, phone: false };

/// The screen of a phone that is held upright.
pub const PHONE: Screen = Screen { width: 390, height: 844, scale: 2, phone: true };

/// A browser with one page.
#[derive(Debug)]
pub struct Tab {
    process: Child,
    to: ChildStdin,
    from: Receiver<Value>,
    session: String,
    commands: u64,
    events: VecDeque<Value>,
    troubles: Vec<String>,
    requests: Vec<String>,
}

impl Tab {
    /// Starts the browser with an empty page. The browser's files are below `folder`, which is emptied first.
    ///
    /// # Panics
    ///
    /// Panics if the browser cannot be started, or does not answer.
    #[must_use]
    pub fn start(program: &Path, folder: &Path) -> Self {
        let _ = std::fs::remove_dir_all(folder);
        // The browser needs the two pipes as file descriptors 3 and 4. The standard library cannot set these up, but
        // the shell can.
        let mut command = Command::new("/bin/sh");
        command.args(["-c", "exec \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1", "sh"]).arg(program);
        command.args(["--headless", "--remote-debugging-pipe", "--disable-gpu", "--no-first-run", "--mute-audio"]);
        // In a container the browser has no shared memory, and as root it cannot use its sandbox. A trusted page does
        // not need the sandbox.
        command.args(["--disable-dev-shm-usage", "--no-sandbox", "--disable-background-networking"]);
        command.args(["--disable-component-update", "--disable-default-apps", "--disable-sync"]);
        command.arg("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1");
        command.arg(format!("--user-data-dir={}", folder.display())).arg("about:blank");
        let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the browser starts");
        let to = process.stdin.take().expect("it was piped");
        let out = process.stdout.take().expect("it was piped");
        let (tell, from) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(out).split(0).map_while(Result::ok) {
                let message = serde_json::from_slice(&message).expect("the browser speaks JSON");
                if tell.send(message).is_err() {
                    return;
                }
            }
        });
        let mut tab = Self {
            process,
            to,
            from,
            session: String::new(),
            commands: 0,
            events: VecDeque::new(),
            troubles: vec![],
            requests: vec![],
        };
        let target = tab.command("Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = tab.command("Target.attachToTarget", attach);
        tab.session = attached["sessionId"].as_str().expect("a session").to_owned();
        for domain in ["Page", "Runtime", "Log", "Network", "Accessibility"] {
            tab.command(&format!("{domain}.enable"), json!({}));
        }
        tab.screen(DESK);
        tab
    }

    /// Carries out a command of the DevTools protocol and returns the result.
    ///
    /// # Panics
    ///
    /// Panics if the command fails, or if the browser does not answer.
    pub fn command(&mut self, method: &str, params: Value) -> Value {
        self.commands += 1;
        let id = self.commands;
        let mut message = json!({ "id": id, "method": method, "params": params });
        if !self.session.is_empty() {
            message["sessionId"] = self.session.clone().into();
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.to.write_all(&bytes).expect("the browser listens");
        loop {
            let message = self.from.recv_timeout(PATIENCE).unwrap_or_else(|error| panic!("{method}: {error}"));
            if message["id"] == id {
                assert!(message.get("error").is_none(), "{method}: {}", message["error"]);
                return message["result"].clone();
            }
            self.note(message);
        }
    }

    fn note(&mut self, event: Value) {
        let params = &event["params"];
        match event["method"].as_str().unwrap_or_default() {
            "Runtime.exceptionThrown" => self.troubles.push(params["exceptionDetails"].to_string()),
            "Runtime.consoleAPICalled" if params["type"] == "error" || params["type"] == "warning" => {
                self.troubles.push(params["args"].to_string());
            }
            "Log.entryAdded" if params["entry"]["level"] == "error" || params["entry"]["level"] == "warning" => {
                let entry = &params["entry"];
                let part = |name: &str| entry[name].as_str().unwrap_or_default().to_owned();
                self.troubles.push(format!("{}: {} {}", part("source"), part("text"), part("url")));
            }
            "Network.requestWillBeSent" => {
                self.requests.extend(params["request"]["url"].as_str().map(str::to_owned));
            }
            _ => {}
        }
        self.events.push_back(event);
    }

    fn listen(&mut self) {
        loop {
            match self.from.recv_timeout(Duration::ZERO) {
                Ok(message) => self.note(message),
                Err(RecvTimeoutError::Timeout) => return,
                Err(RecvTimeoutError::Disconnected) => panic!("the browser has ended"),
            }
        }
    }

    /// Opens a page and waits until it is loaded.
    pub fn open(&mut self, address: &str) {
        self.events.clear();
        let opened = self.command("Page.navigate", json!({ "url": address }));
        assert_eq!(opened.get("errorText"), None, "{address}");
        let began = Instant::now();
        while !self.events.iter().any(|event| event["method"] == "Page.loadEventFired") {
            assert!(began.elapsed() < PATIENCE, "{address} is not there");
            std::thread::sleep(LOOK);
            self.listen();
        }
    }

    /// Returns the value of a JavaScript expression, which is awaited if it is a promise.
    ///
    /// # Panics
    ///
    /// Panics if the expression throws.
    pub fn eval(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let done = self.command("Runtime.evaluate", params);
        assert!(done.get("exceptionDetails").is_none(), "{expression}: {}", done["exceptionDetails"]);
        done["result"]["value"].clone()
    }

    /// Returns the displayed text of the first element that a CSS selector finds.
    pub fn text(&mut self, selector: &str) -> String {
        let text = self.eval(&format!("document.querySelector({}).innerText", Value::from(selector)));
        text.as_str().unwrap_or_default().trim().to_owned()
    }

    /// Waits until a JavaScript expression is true.
    ///
    /// # Panics
    ///
    /// Panics if the expression is not true within a minute.
    pub fn until(&mut self, expression: &str) {
        let began = Instant::now();
        while self.eval(expression) != Value::Bool(true) {
            assert!(began.elapsed() < PATIENCE, "never: {expression}\n{}", self.text("body"));
            std::thread::sleep(LOOK);
        }
    }

    /// Displays the page on this screen from now on.
    pub fn screen(&mut self, screen: Screen) {
        let Screen { width, height, scale, phone } = screen;
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": scale, "mobile": phone });
        self.command("Emulation.setDeviceMetricsOverride", metrics);
    }

    /// Sets the user's preferred colour scheme from now on: `light` or `dark`.
    pub fn scheme(&mut self, scheme: &str) {
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.command("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Presses and releases a key: `Tab`, `Enter`, `Space`, `ArrowDown`, …, or a small letter.
    ///
    /// # Panics
    ///
    /// Panics if the table of keys has no such key.
    pub fn press(&mut self, key: &str) {
        // The columns are the key, its code, Windows' code and the text, from https://www.w3.org/TR/uievents-code/.
        let (key, code, number, text) = match (key, key.as_bytes()) {
            ("Tab", _) => ("Tab", "Tab".to_owned(), 9, ""),
            ("Enter", _) => ("Enter", "Enter".to_owned(), 13, "\r"),
            ("Space", _) => (" ", "Space".to_owned(), 32, " "),
            ("End", _) => ("End", "End".to_owned(), 35, ""),
            ("Home", _) => ("Home", "Home".to_owned(), 36, ""),
            ("ArrowLeft", _) => ("ArrowLeft", "ArrowLeft".to_owned(), 37, ""),
            ("ArrowRight", _) => ("ArrowRight", "ArrowRight".to_owned(), 39, ""),
            ("ArrowDown", _) => ("ArrowDown", "ArrowDown".to_owned(), 40, ""),
            (letter, [byte @ b'a'..=b'z']) => {
                let large = byte.to_ascii_uppercase();
                (letter, format!("Key{}", char::from(large)), large, letter)
            }
            _ => panic!("no key {key} here"),
        };
        for kind in ["keyDown", "keyUp"] {
            let mut params = json!({ "type": kind, "key": key, "code": code, "windowsVirtualKeyCode": number });
            if kind == "keyDown" {
                params["text"] = text.into();
            }
            self.command("Input.dispatchKeyEvent", params);
        }
    }

    /// Returns the role and the name of each element that a screen reader reads out.
    pub fn spoken(&mut self) -> Vec<(String, String)> {
        let tree = self.command("Accessibility.getFullAXTree", json!({}));
        let nodes = tree["nodes"].as_array().cloned().unwrap_or_default();
        let part = |node: &Value, name: &str| node[name]["value"].as_str().unwrap_or_default().trim().to_owned();
        let heard = nodes.iter().filter(|node| node["ignored"] != true);
        heard.map(|node| (part(node, "role"), part(node, "name"))).collect()
    }

    /// Writes a picture of the whole page, as a PNG.
    ///
    /// # Panics
    ///
    /// Panics if the file cannot be written.
    pub fn picture(&mut self, path: &Path) {
        let shot = self.command("Page.captureScreenshot", json!({ "captureBeyondViewport": true }));
        let bytes = BASE64_STANDARD.decode(shot["data"].as_str().expect("a picture")).expect("base64");
        let written = path.parent().map_or(Ok(()), std::fs::create_dir_all).and_then(|()| std::fs::write(path, bytes));
        written.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    }

    /// Returns the addresses that the page has requested since the last call.
    pub fn requests(&mut self) -> Vec<String> {
        self.listen();
        std::mem::take(&mut self.requests)
    }

    /// Returns the page's errors since the last call: exceptions, and errors and warnings of the console.
    pub fn troubles(&mut self) -> Vec<String> {
        self.listen();
        std::mem::take(&mut self.troubles)
    }
}

impl Drop for Tab {
    fn drop(&mut self) {
        // An error is ignored, because the browser may have ended already. The browser's helper processes end with the
        // browser.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
