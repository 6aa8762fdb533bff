//! Commands from the broker: `Node Control/Rebirth` of the edge node, and `Command/...` of a device.

use super::metrics::Devices;
use super::payload::{Metric, Payload, Value};
use meshband::config::Configuration;
use meshband::message::Request;
use prost::Message;

/// What a command asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// All births again.
    Rebirth,
    /// Something of a node.
    Node {
        /// Device.
        device: String,
        /// Requests in order.
        requests: Vec<Request>,
        /// For the history.
        name: String,
    },
    /// Not carried out.
    Refused {
        /// Device, where the command has one.
        device: Option<String>,
        /// Why.
        reason: String,
    },
}

/// Reads a command message; one that asks for several things gives several commands.
pub fn read(topic: &str, bytes: &[u8], allow_configure: bool, devices: &Devices) -> Vec<Command> {
    let parts: Vec<&str> = topic.split('/').collect();
    let device = parts.get(4).map(|&device| device.to_owned());
    let Ok(payload) = Payload::decode(bytes) else {
        return vec![Command::Refused { device, reason: "no Sparkplug payload".to_owned() }];
    };
    payload.metrics.iter().filter_map(|wanted| one(device.clone(), wanted, allow_configure, devices)).collect()
}

fn one(device: Option<String>, wanted: &Metric, allow_configure: bool, devices: &Devices) -> Option<Command> {
    let asked = matches!(wanted.value, Some(Value::Boolean(true)));
    let Some(device) = device else {
        // The edge node's own metrics have no aliases.
        return (wanted.name.as_deref() == Some("Node Control/Rebirth") && asked).then_some(Command::Rebirth);
    };
    let by_alias = |alias| devices.metric_name(&device, alias).map(str::to_owned);
    let Some(name) = wanted.name.clone().or_else(|| by_alias(wanted.alias?)) else {
        let reason = format!("alias {:?} is of no metric of {device}", wanted.alias);
        return Some(Command::Refused { device: Some(device), reason });
    };
    let requests = match (name.as_str(), &wanted.value) {
        ("Command/Start", _) if asked => vec![Request::Start],
        ("Command/Stop", _) if asked => vec![Request::Stop],
        ("Command/Snapshot", _) if asked => vec![Request::Snapshot],
        ("Command/Acknowledge", _) if asked => vec![Request::AcknowledgeAlarms],
        ("Command/Configure", Some(Value::Text(_))) if !allow_configure => {
            let reason = "Command/Configure: broker.allow_configure is not set".to_owned();
            return Some(Command::Refused { device: Some(device), reason });
        }
        ("Command/Configure", Some(Value::Text(text))) => match serde_json::from_str::<Configuration>(text) {
            Ok(configuration) => vec![Request::SetConfiguration(configuration), Request::CommitConfiguration],
            Err(reason) => {
                let reason = format!("Command/Configure: {reason}");
                return Some(Command::Refused { device: Some(device), reason });
            }
        },
        // A command taken back, and metrics that are no commands.
        (_, Some(Value::Boolean(false))) => return None,
        _ => return Some(Command::Refused { device: Some(device), reason: format!("{name} is no command") }),
    };
    Some(Command::Node { device, requests, name })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(topic: &str, name: &str, value: Value, allow: bool) -> Vec<Command> {
        let metric = Metric { name: Some(name.to_owned()), value: Some(value), ..Metric::default() };
        read(
            topic,
            &Payload { timestamp: None, metrics: vec![metric], seq: None }.encode_to_vec(),
            allow,
            &Devices::default(),
        )
    }

    #[test]
    fn claim_configuration_is_behind_its_switch_and_nonsense_is_refused() {
        let device = "spBv1.0/g/DCMD/e/d";
        let text = serde_json::to_string(&Configuration::default()).expect("serialises");
        let refused = |commands: &[Command]| matches!(commands, [Command::Refused { .. }]);
        assert!(refused(&ask(device, "Command/Configure", Value::Text(text.clone()), false)));
        assert!(refused(&ask(device, "Command/Configure", Value::Text("{}".into()), true)));
        assert!(refused(&ask(device, "Speed", Value::Float(1.0), true)));
        assert!(refused(&read(device, b"\xff\xff", true, &Devices::default())));
        let taken = ask(device, "Command/Configure", Value::Text(text), true);
        assert!(matches!(&taken[..], [Command::Node { requests, .. }] if requests.len() == 2));
        assert_eq!(ask("spBv1.0/g/NCMD/e", "Node Control/Rebirth", Value::Boolean(true), false), [Command::Rebirth]);
        assert_eq!(ask(device, "Command/Stop", Value::Boolean(false), false), []);
    }
}
