//! The records of a campaign's plan: part, number, what is hidden, and how strong.

use super::Plan;
use crate::effects;
use crate::effects::hypothesis::Hidden;

/// One record to be made.
pub struct Item {
    /// Part of the campaign.
    pub part: &'static str,
    /// Its number within the part.
    pub number: usize,
    /// What is hidden.
    pub hidden: Vec<&'static Hidden>,
    /// Strength over the detection floor, or over the record's own limit.
    pub level: f64,
}

impl Item {
    /// Name in the log.
    pub fn id(&self) -> String {
        format!("{}-{}", self.part, self.number)
    }
}

/// Every record of the plan.
pub fn items(plan: &Plan) -> Vec<Item> {
    let wanted = |h: &&Hidden| plan.only.is_empty() || plan.only.iter().any(|n| n == h.name);
    let all: Vec<&'static Hidden> = effects::hidden().filter(wanted).collect();
    let count = all.len();
    let named: Vec<&'static Hidden> = all.iter().copied().filter(|h| !h.right_names.is_empty()).collect();
    let mut items: Vec<Item> =
        (0..plan.null).map(|number| Item { part: "null", number, hidden: vec![], level: 0.0 }).collect();
    items.extend((0..plan.power).map(|number| {
        let level = plan.levels[number / count % plan.levels.len()];
        Item { part: "power", number, hidden: vec![all[number % count]], level }
    }));
    items.extend((0..plan.leave_one_out).map(|number| Item {
        part: "leave-one-out",
        number,
        hidden: vec![named[number % named.len()]],
        level: 4.0,
    }));
    // Half and nine tenths are the promises at the limit and at twice it.
    items.extend((0..plan.limits).map(|number| Item {
        part: "limit",
        number,
        hidden: vec![],
        level: [1.0, 2.0][number % 2],
    }));
    for number in 0..plan.two {
        let first = named[number % named.len()];
        let second = named[(number + 1 + number / named.len() * 3 + 4) % named.len()];
        let second = if second.name == first.name { named[(number + 1) % named.len()] } else { second };
        items.push(Item { part: "two", number, hidden: vec![first, second], level: 4.0 });
        items.push(Item { part: "parameter", number, hidden: vec![first], level: 4.0 });
    }
    items
}
