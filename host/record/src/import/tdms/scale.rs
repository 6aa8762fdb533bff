//! Scales that a TDMS file states: a chain of steps from raw numbers to the quantity.
//!
//! Source: the properties `NI_Scale[i]_...` as LabVIEW and DAQmx write them; steps, their inputs and the order in
//! which channel, group and file are asked are those of npTDMS 1.13. Read: linear, polynomial, table, sum,
//! difference, and the raw scalers of DAQmx.

use super::{Object, Property};
use std::collections::BTreeMap;

/// Input of a step that is the raw data.
const RAW_INPUT: f64 = 4_294_967_295.0;
/// Steps that one file may state.
const MOST_STEPS: usize = 64;
/// Coefficients or points of one step.
const MOST_POINTS: usize = 100_000;

type Properties = BTreeMap<String, Property>;

/// One step of a chain.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    /// A raw scaler of DAQmx.
    Scaler(u32),
    /// The input as it is.
    Through(f64),
    Polynomial {
        input: f64,
        coefficients: Vec<f64>,
    },
    Table {
        input: f64,
        from: Vec<f64>,
        to: Vec<f64>,
    },
    Sum {
        left: f64,
        right: f64,
        sign: f64,
    },
}

/// The steps that the first of channel, group and file states; `None` where the numbers are values.
fn steps(sources: [Option<&Properties>; 3]) -> Result<Option<Vec<Step>>, String> {
    for properties in sources.into_iter().flatten() {
        let count = match properties.get("NI_Number_Of_Scales") {
            Some(Property::Number(count)) => *count as usize,
            _ => {
                let indices = properties.keys().filter_map(|key| {
                    key.strip_prefix("NI_Scale[")?.strip_suffix("]_Scale_Type")?.parse::<usize>().ok()
                });
                indices.max().map_or(0, |last| last.saturating_add(1))
            }
        };
        if count == 0 || properties.get("NI_Scaling_Status") == Some(&Property::Text("scaled".into())) {
            continue;
        }
        if count > MOST_STEPS {
            return Err(format!("states {count} scales"));
        }
        return (0..count).map(|i| step(properties, i)).collect::<Result<_, _>>().map(Some);
    }
    Ok(None)
}

fn step(properties: &Properties, i: usize) -> Result<Step, String> {
    let text = |key: &str| match properties.get(&format!("NI_Scale[{i}]_{key}")) {
        Some(Property::Text(text)) => Some(text.clone()),
        _ => None,
    };
    let number = |key: String| match properties.get(&format!("NI_Scale[{i}]_{key}")) {
        Some(Property::Number(number)) => Some(*number),
        _ => None,
    };
    let Some(kind) = text("Scale_Type") else { return Ok(Step::Scaler(i as u32)) };
    let input = |name: &str| number(format!("{name}_Input_Source")).unwrap_or(RAW_INPUT);
    let needed = |key: String| number(key.clone()).ok_or_else(|| format!("states a scale without {key}"));
    let list = |key: &str, count: f64| -> Result<Vec<f64>, String> {
        if !(0.0..=MOST_POINTS as f64).contains(&count) {
            return Err(format!("states a scale of {count} numbers"));
        }
        (0..count as usize).map(|k| needed(format!("{key}[{k}]"))).collect()
    };
    match kind.as_str() {
        "Linear" => Ok(Step::Polynomial {
            input: input("Linear"),
            coefficients: vec![needed("Linear_Y_Intercept".into())?, needed("Linear_Slope".into())?],
        }),
        "Polynomial" => {
            let count = number("Polynomial_Coefficients_Size".into()).unwrap_or(4.0);
            Ok(Step::Polynomial { input: input("Polynomial"), coefficients: list("Polynomial_Coefficients", count)? })
        }
        "Table" => {
            let (mut from, mut to) = (
                list("Table_Pre_Scaled_Values", needed("Table_Pre_Scaled_Values_Size".into())?)?,
                list("Table_Scaled_Values", needed("Table_Scaled_Values_Size".into())?)?,
            );
            if from.windows(2).all(|w| w[0] > w[1]) {
                from.reverse();
                to.reverse();
            }
            if from.len() != to.len() || from.is_empty() || from.windows(2).any(|w| w[0] >= w[1]) {
                return Err("states a table that does not ascend".into());
            }
            Ok(Step::Table { input: input("Table"), from, to })
        }
        "Add" | "Subtract" => {
            let side = |side: &str| needed(format!("{kind}_{side}_Operand_Input_Source"));
            Ok(Step::Sum { left: side("Left")?, right: side("Right")?, sign: if kind == "Add" { 1.0 } else { -1.0 } })
        }
        "AdvancedAPI" => Ok(Step::Through(input("AdvancedAPI"))),
        other => Err(format!("has a scale of the kind {}, which is not read", crate::text::quoted(other))),
    }
}

/// The values of a channel with its scales.
pub(super) fn scaled(
    object: Object,
    group: Option<&Properties>,
    file: Option<&Properties>,
) -> Result<Vec<f64>, String> {
    let Some(steps) = steps([Some(&object.properties), group, file])? else {
        if object.values.is_empty() && !object.scalers.is_empty() {
            return Err("holds raw data of DAQmx without a scale".into());
        }
        return Ok(object.values);
    };
    // One polynomial of the raw data needs no copies.
    if let [Step::Polynomial { input, coefficients }] = steps.as_slice()
        && *input == RAW_INPUT
        && object.scalers.is_empty()
    {
        let mut values = object.values;
        values.iter_mut().for_each(|x| *x = polynomial(coefficients, *x));
        return Ok(values);
    }
    evaluate(&steps, steps.len() - 1, &object, 0)
}

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

fn evaluate(steps: &[Step], at: usize, object: &Object, depth: usize) -> Result<Vec<f64>, String> {
    if depth > MOST_STEPS {
        return Err("states scales that refer to each other in a circle".into());
    }
    let of = |input: f64| -> Result<Vec<f64>, String> {
        if input == RAW_INPUT {
            return Ok(object.values.clone());
        }
        let index = input as usize;
        if input < 0.0 || index >= steps.len() {
            return Err(format!("states a scale of the input {input}, which is none"));
        }
        evaluate(steps, index, object, depth + 1)
    };
    match &steps[at] {
        Step::Scaler(id) => {
            object.scalers.get(id).cloned().ok_or_else(|| format!("states the scaler {id}, which is none"))
        }
        Step::Through(input) => of(*input),
        Step::Polynomial { input, coefficients } => {
            let mut values = of(*input)?;
            values.iter_mut().for_each(|x| *x = polynomial(coefficients, *x));
            Ok(values)
        }
        Step::Table { input, from, to } => {
            let mut values = of(*input)?;
            values.iter_mut().for_each(|x| *x = between(from, to, *x));
            Ok(values)
        }
        Step::Sum { left, right, sign } => {
            // What LabVIEW calls the left operand is the one that is taken away.
            let (left, right) = (of(*left)?, of(*right)?);
            Ok(right.iter().zip(&left).map(|(right, left)| right + sign * left).collect())
        }
    }
}

fn between(from: &[f64], to: &[f64], x: f64) -> f64 {
    let at = from.partition_point(|edge| *edge <= x);
    if at == 0 {
        return to[0];
    }
    if at == from.len() {
        return to[at - 1];
    }
    let share = (x - from[at - 1]) / (from[at] - from[at - 1]);
    to[at - 1] + share * (to[at] - to[at - 1])
}
