//! An listener on what a robot says of itself.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::ros2::node::{LinkNode, Topics, drain};
use crate::served::Status;

/// Listens to a robot's status from a thread of its own, and keeps all it heard with the time at which it was
/// heard.
pub struct StatusListener {
    heard: Arc<Mutex<Vec<(Instant, Status)>>>,
    stop: Arc<AtomicBool>,
    listener: Option<JoinHandle<()>>,
}

impl StatusListener {
    /// Begins to listen.
    ///
    /// # Errors
    ///
    /// [`LinkError`] if the network cannot be joined.
    pub fn open(link: &Ros2Config) -> Result<Self, LinkError> {
        let mut node = LinkNode::open(link, "stridemap_ear")?;
        let listener = node.subscription(Topics::STATUS)?;
        let heard = Arc::new(Mutex::new(Vec::new()));
        let stop = Arc::new(AtomicBool::new(false));
        let (into, until) = (Arc::clone(&heard), Arc::clone(&stop));
        let listener = std::thread::Builder::new()
            .name("status-listener".into())
            .spawn(move || {
                // The node lives as long as its listener.
                let _node = node;
                while !until.load(Ordering::Relaxed) {
                    let new = drain::<crate::messages::Text>(&listener, &mut 0);
                    let now = Instant::now();
                    let read = new
                        .iter()
                        .filter_map(|(text, _)| serde_json::from_str(&text.data).ok())
                        .map(|status| (now, status));
                    if let Ok(mut heard) = into.lock() {
                        heard.extend(read);
                    }
                    std::thread::sleep(Duration::from_millis(1));
                }
            })
            .map_err(|e| LinkError::Network(format!("an listener cannot be opened: {e}")))?;
        Ok(Self { heard, stop, listener: Some(listener) })
    }

    /// What was heard since `since`, oldest first.
    #[must_use]
    pub fn since(&self, since: Instant) -> Vec<Status> {
        let heard = self.heard.lock().map(|h| h.clone()).unwrap_or_default();
        let new = heard.into_iter().filter(|(at, _)| *at >= since);
        new.map(|(_, status)| status).collect()
    }

    /// What was heard last.
    #[must_use]
    pub fn last(&self) -> Option<Status> {
        let heard = self.heard.lock().ok()?;
        heard.last().map(|(_, status)| status.clone())
    }

    /// Waits until something that was heard after `since` answers `done`, or for this long; whether it came.
    pub fn wait(&self, since: Instant, most: Duration, done: impl Fn(&Status) -> bool) -> bool {
        let deadline = Instant::now() + most;
        loop {
            if self.since(since).iter().any(&done) {
                return true;
            }
            if Instant::now() > deadline {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for StatusListener {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(listener) = self.listener.take() {
            let _ = listener.join();
        }
    }
}
