//! Effects as a command line has them: `name:key=value,...`, amplitudes in m.
//!
//! `runout:gear=0,amplitude=1e-5,phase=0.2`; `ghost:gear=1,order=37,amplitude=2e-6`; `tooth-error:gear=2,tooth=5,
//! amplitude=2e-5`; `tooth-stiffness:gear=1,planet=0,tooth=5,loss=0.4`. Gears are counted from 0 in the order of the
//! stages, driver first, sun, planet, ring of a set; a planet's own number is needed.

use crate::effects::{Effect, Seat};
use crate::{Error, Result};

/// Names of effects with their keys.
const FORMS: [(&str, &[&str]); 4] = [
    ("runout", &["gear", "planet", "amplitude", "phase"]),
    ("ghost", &["gear", "planet", "order", "amplitude", "phase"]),
    ("tooth-error", &["gear", "planet", "tooth", "amplitude"]),
    ("tooth-stiffness", &["gear", "planet", "tooth", "loss"]),
];

/// Values of one effect's keys.
struct Values<'t> {
    text: &'t str,
    pairs: Vec<(&'t str, f64)>,
}

impl Effect {
    /// Reads an effect.
    ///
    /// # Errors
    /// An unknown name or key, a missing or impossible value, with the text.
    pub fn parse(text: &str) -> Result<Self> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        let Some((_, keys)) = FORMS.iter().find(|(form, _)| *form == name) else {
            let names: Vec<&str> = FORMS.iter().map(|(name, _)| *name).collect();
            return Err(refused(text, &format!("an effect of a train is one of {}", names.join(", "))));
        };
        let values = Values::of(text, rest, keys)?;
        let planet = if values.has("planet") { Some(values.whole("planet")? as usize) } else { None };
        let at = Seat { gear: values.whole("gear")? as usize, planet };
        let phase = || if values.has("phase") { values.number("phase") } else { Ok(0.0) };
        Ok(match name {
            "runout" => Self::Runout { at, amplitude_m: values.number("amplitude")?, phase_turns: phase()? },
            "ghost" => {
                let (order, amplitude_m) = (values.whole("order")?, values.number("amplitude")?);
                Self::Ghost { at, order, amplitude_m, phase_turns: phase()? }
            }
            "tooth-error" => {
                Self::ToothError { at, tooth: values.whole("tooth")?, error_m: values.number("amplitude")? }
            }
            _ => Self::ToothStiffness { at, tooth: values.whole("tooth")?, loss: values.number("loss")? },
        })
    }
}

impl<'t> Values<'t> {
    fn of(text: &'t str, rest: &'t str, keys: &[&str]) -> Result<Self> {
        let mut pairs: Vec<(&str, f64)> = Vec::new();
        for part in rest.split(',').filter(|part| !part.is_empty()) {
            let value = part.split_once('=').and_then(|(key, value)| Some((key.trim(), value.trim().parse().ok()?)));
            let Some((key, value)) = value else {
                return Err(refused(text, &format!("`{part}` is not key=number")));
            };
            if !keys.contains(&key) {
                return Err(refused(text, &format!("unknown key `{key}`; it has {}", keys.join(", "))));
            }
            if pairs.iter().any(|(known, _)| *known == key) {
                return Err(refused(text, &format!("`{key}` stands twice")));
            }
            pairs.push((key, value));
        }
        Ok(Self { text, pairs })
    }

    fn has(&self, key: &str) -> bool {
        self.pairs.iter().any(|(known, _)| *known == key)
    }

    fn number(&self, key: &str) -> Result<f64> {
        let value = self.pairs.iter().find(|(known, _)| *known == key).map(|(_, value)| *value);
        value.filter(|value| value.is_finite()).ok_or_else(|| refused(self.text, &format!("needs a number {key}=")))
    }

    fn whole(&self, key: &str) -> Result<u32> {
        let value = self.number(key)?;
        if value >= 0.0 && value <= f64::from(u16::MAX) && value.fract() == 0.0 {
            return Ok(value as u32);
        }
        Err(refused(self.text, &format!("{key}={value} is no count")))
    }
}

fn refused(text: &str, what: &str) -> Error {
    Error::invalid(format!("--effect {text}"), what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claim_every_form_is_read_as_it_is_written() {
        let at = Seat { gear: 1, planet: Some(2) };
        let soft = Effect::parse("tooth-stiffness:gear=1,planet=2,tooth=5,loss=0.4").expect("an effect");
        assert_eq!(soft, Effect::ToothStiffness { at, tooth: 5, loss: 0.4 });
        let at = Seat { gear: 0, planet: None };
        let runout = Effect::parse("runout:gear=0,amplitude=1e-5,phase=0.25").expect("an effect");
        assert_eq!(runout, Effect::Runout { at, amplitude_m: 1e-5, phase_turns: 0.25 });
        let ghost = Effect::parse("ghost:gear=0,order=37,amplitude=2e-6").expect("an effect");
        assert_eq!(ghost, Effect::Ghost { at, order: 37, amplitude_m: 2e-6, phase_turns: 0.0 });
        let error = Effect::parse("tooth-error:gear=0,tooth=3,amplitude=-2e-6").expect("an effect");
        assert_eq!(error, Effect::ToothError { at, tooth: 3, error_m: -2e-6 });
    }

    #[test]
    fn fault_other_texts_are_refused_with_what_is_wrong() {
        for (text, words) in [
            ("eccentricity:amplitude=1e-6", "one of"),
            ("runout:amplitude=1e-6", "gear="),
            ("runout:gear=0", "amplitude="),
            ("runout:gear=0.5,amplitude=1e-6", "no count"),
            ("runout:gear=0,amplitude=nan", "amplitude="),
            ("runout:gear=0,gear=1,amplitude=1e-6", "twice"),
            ("runout:gear=0,size=1e-6", "unknown key"),
            ("runout:gear", "key=number"),
        ] {
            let error = Effect::parse(text).expect_err("refused").to_string();
            assert!(error.contains(words) && error.contains("--effect"), "{error}");
        }
    }
}
