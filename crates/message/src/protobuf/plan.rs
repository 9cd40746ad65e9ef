//! Fields to decode, by message, and their forms.

use std::{collections::HashMap, sync::Arc};

use super::types::{FieldType, Form, MessageType};
use crate::{Value, lookup::Wanted, value::LONG_ARRAY};

/// Messages to decode; the first is the whole message.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) messages: Vec<MessagePlan>,
}

/// The fields of one message that are decoded.
#[derive(Debug, Default)]
pub(super) struct MessagePlan {
    pub(super) fields: Vec<FieldPlan>,
    /// Field numbers, ascending, with their places in `fields`.
    numbers: Vec<(u32, usize)>,
}

/// A field that is decoded.
#[derive(Debug)]
pub(super) struct FieldPlan {
    pub(super) name: Arc<str>,
    number: u32,
    pub(super) form: Form,
    /// For repeated fields, how many elements are kept.
    pub(super) list: Option<Keep>,
    /// For bytes, how many are kept.
    pub(super) bytes: Keep,
    /// Setting it clears the other members of the same number.
    pub(super) oneof: Option<usize>,
    /// Value of the field in a message without it.
    pub(super) absent: Value,
}

/// Number of elements of an array to decode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Keep {
    pub(super) elements: usize,
    /// An array of more elements is [`Value::Long`]; else it is cut.
    pub(super) or_count: bool,
}

impl Keep {
    const SHORT: Self = Self { elements: LONG_ARRAY, or_count: true };
    const ALL: Self = Self { elements: usize::MAX, or_count: false };
}

impl FieldPlan {
    /// A field that is not decoded.
    fn unwanted(field: &FieldType) -> Self {
        Self {
            name: field.name.clone(),
            number: field.number,
            form: Form::Unwanted,
            list: None,
            bytes: Keep::SHORT,
            oneof: field.oneof,
            absent: Value::Null,
        }
    }
}

impl MessagePlan {
    fn push(&mut self, field: FieldPlan) {
        self.numbers.push((field.number, self.fields.len()));
        self.fields.push(field);
    }

    /// The place of a field; `guess` is where it would be when fields come in order.
    pub(super) fn place(&self, number: u32, guess: usize) -> Option<usize> {
        if let Some(&(numbered, place)) = self.numbers.get(guess)
            && numbered == number
        {
            return Some(place);
        }
        self.numbers.binary_search_by_key(&number, |(number, _)| *number).ok().map(|at| self.numbers[at].1)
    }
}

impl Plan {
    /// Everything in a message of the first of some types; types may contain themselves.
    pub(super) fn whole(types: &[MessageType]) -> Self {
        Self::new(types, None)
    }

    /// Plan for the wanted parts of a message of the first type.
    pub(super) fn wanted(types: &[MessageType], wanted: &Wanted) -> Self {
        Self::new(types, Some(wanted))
    }

    fn new(types: &[MessageType], wanted: Option<&Wanted>) -> Self {
        let mut planner = Planner { todo: vec![(0, wanted)], known: HashMap::from([(0, 0)]) };
        let mut messages = Vec::new();
        while let Some(&(place, wanted)) = planner.todo.get(messages.len()) {
            messages
                .push(types.get(place).map(|message_type| planner.message(message_type, wanted)).unwrap_or_default());
        }
        Self { messages }
    }
}

/// Messages that are planned, in the order of the plan: their types and what is wanted of them, or all.
struct Planner<'a> {
    todo: Vec<(usize, Option<&'a Wanted>)>,
    /// Types that are decoded as a whole.
    known: HashMap<usize, usize>,
}

impl<'a> Planner<'a> {
    fn message(&mut self, message_type: &MessageType, wanted: Option<&'a Wanted>) -> MessagePlan {
        let mut plan = MessagePlan::default();
        for field in &message_type.fields {
            let part = match wanted {
                None => None,
                Some(wanted) => match wanted.fields.iter().find(|(name, _)| *name == field.name) {
                    Some((_, part)) => Some(part),
                    None => continue,
                },
            };
            let Some(form) = self.form(field, part) else { continue };
            let kept = part.map(|part| Keep { elements: part.elements, or_count: false });
            plan.push(FieldPlan {
                list: field.is_list.then(|| kept.unwrap_or(if form.is_number() { Keep::SHORT } else { Keep::ALL })),
                bytes: kept.unwrap_or(Keep::SHORT),
                form,
                absent: field.absent.clone(),
                ..FieldPlan::unwanted(field)
            });
        }
        // Members of oneofs that have wanted ones clear these, also where nobody wants them.
        for field in message_type.fields.iter().filter(|field| field.oneof.is_some()) {
            let has = |has: &dyn Fn(&FieldPlan) -> bool| plan.fields.iter().any(has);
            if has(&|other| other.oneof == field.oneof) && !has(&|other| other.name == field.name) {
                plan.push(FieldPlan::unwanted(field));
            }
        }
        plan.numbers.sort_unstable();
        plan
    }

    /// Form of a field; `None` for a message that is wanted as if it were a number.
    fn form(&mut self, field: &FieldType, part: Option<&'a Wanted>) -> Option<Form> {
        let Form::Message(message_index) = field.form else { return Some(field.form) };
        let next = self.todo.len();
        let place = match part {
            Some(part) if part.fields.is_empty() => return None,
            Some(_) => next,
            None => *self.known.entry(message_index).or_insert(next),
        };
        if place == next {
            self.todo.push((message_index, part));
        }
        Some(Form::Message(place))
    }
}
