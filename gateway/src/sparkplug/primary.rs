//! The primary host: the host application without which an edge node publishes nothing.
//!
//! It says on `spBv1.0/STATE/ID` whether it is online, as a retained message, and its will says so when it is gone. The
//! will of a former session can come late: by its timestamp it is known to be of the past.

use super::session::NAMESPACE;
use serde::Deserialize;

/// A STATE message; milliseconds since 1970.
#[derive(Deserialize)]
struct State {
    online: bool,
    timestamp: u64,
}

/// The primary host and what its messages said. A new session does not forget it: the broker repeats the newest one.
#[derive(Clone, Debug)]
pub struct PrimaryHost {
    /// Topic of its state.
    pub topic: String,
    /// Timestamp of the newest message taken, online or not.
    newest_ms: Option<u64>,
    /// Timestamp of the newest message that said it is online.
    online_ms: Option<u64>,
}

impl PrimaryHost {
    /// A host of which nothing was heard.
    pub fn new(id: &str) -> Self {
        Self { topic: format!("{NAMESPACE}/STATE/{id}"), newest_ms: None, online_ms: None }
    }

    /// Takes a message; gives whether the host is online, `None` where the message does not say so.
    pub fn hear(&mut self, topic: &str, bytes: &[u8]) -> Option<bool> {
        let state: State = if topic == self.topic { serde_json::from_slice(bytes).ok()? } else { return None };
        let least_ms = if state.online { self.newest_ms } else { self.online_ms };
        if least_ms.is_some_and(|least_ms| state.timestamp < least_ms) {
            return None;
        }
        self.newest_ms = self.newest_ms.max(Some(state.timestamp));
        if state.online {
            self.online_ms = Some(state.timestamp);
        }
        Some(state.online)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What each message says, of which one has the text and the host's own topic.
    fn heard(messages: &[&str]) -> Vec<Option<bool>> {
        let mut host = PrimaryHost::new("scada");
        messages.iter().map(|text| host.hear("spBv1.0/STATE/scada", text.as_bytes())).collect()
    }

    fn state(online: bool, timestamp: u64) -> String {
        format!("{{\"online\":{online},\"timestamp\":{timestamp}}}")
    }

    #[test]
    fn claim_online_counts_from_the_newest_message_on_and_offline_from_the_newest_online_one_on() {
        for (messages, says) in [
            (vec![(true, 5)], vec![Some(true)]),
            (vec![(false, 5)], vec![Some(false)]),
            (vec![(true, 5), (false, 5), (true, 5)], vec![Some(true), Some(false), Some(true)]),
            (vec![(true, 5), (false, 4), (true, 4)], vec![Some(true), None, None]),
            (vec![(true, 5), (false, 9), (true, 8), (true, 9)], vec![Some(true), Some(false), None, Some(true)]),
            (vec![(false, 9), (true, 8), (false, 7)], vec![Some(false), None, Some(false)]),
        ] {
            let texts: Vec<String> = messages.iter().map(|&(online, timestamp)| state(online, timestamp)).collect();
            assert_eq!(heard(&texts.iter().map(String::as_str).collect::<Vec<_>>()), says, "{messages:?}");
        }
    }

    #[test]
    fn fault_another_host_and_what_is_no_state_say_nothing() {
        let texts = ["ONLINE", "", "{}", "{\"online\":true}", "{\"online\":\"true\",\"timestamp\":1}"];
        assert_eq!(heard(&texts), [None; 5]);
        let mut host = PrimaryHost::new("scada");
        for topic in ["spBv1.0/STATE/scada2", "spBv1.0/STATE/x/scada", "STATE/scada"] {
            assert_eq!(host.hear(topic, state(true, 1).as_bytes()), None, "{topic}");
        }
    }
}
