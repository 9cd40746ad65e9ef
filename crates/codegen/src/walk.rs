//! Visiting every expression of some code.

use crate::code::{Argument, Code, Condition, Index, Place, Real, Statement, Values, Variable};

/// Calls `visit` for every real expression, parts included.
pub(crate) fn reals(statements: &[Statement], visit: &mut dyn FnMut(&Real)) {
    for statement in statements {
        match statement {
            Statement::Let(_, value)
            | Statement::Variable(_, value)
            | Statement::Set(_, value)
            | Statement::Add(_, value) => expression(value, visit),
            Statement::For { body, .. } => reals(body, visit),
            Statement::If(condition, then, otherwise) => {
                self::condition(condition, visit);
                reals(then, visit);
                reals(otherwise, visit);
            }
            Statement::Call { arguments, .. } => {
                for argument in arguments {
                    match argument {
                        Argument::Value(value) => expression(value, visit),
                        Argument::In(name) | Argument::Out(name) => visit(&Real::Local(name.clone())),
                    }
                }
            }
            Statement::Comment(_)
            | Statement::Array(..)
            | Statement::Counter(..)
            | Statement::SetCounter(..)
            | Statement::Return(_) => {}
        }
    }
}

pub(crate) fn condition(condition: &Condition, visit: &mut dyn FnMut(&Real)) {
    match condition {
        Condition::Less(a, b) | Condition::AtLeast(a, b) | Condition::Equal(a, b) => {
            expression(a, visit);
            expression(b, visit);
        }
        Condition::Outside(value, low, high) => {
            expression(value, visit);
            expression(low, visit);
            expression(high, visit);
        }
        Condition::NotFinite(value) => expression(value, visit),
        Condition::Same(..) | Condition::Failed(_) => {}
    }
}

fn expression(value: &Real, visit: &mut dyn FnMut(&Real)) {
    visit(value);
    match value {
        Real::Number(_) | Real::Local(_) | Real::At(..) => {}
        Real::Unary(_, x) => expression(x, visit),
        Real::Binary(_, a, b) => {
            expression(a, visit);
            expression(b, visit);
        }
        Real::Sum(terms) => terms.iter().for_each(|term| expression(term, visit)),
    }
}

/// Calls `visit` for every number of the code, with where it stands.
pub(crate) fn numbers(code: &Code, visit: &mut dyn FnMut(f64, &str)) {
    for table in &code.tables {
        if let Values::Reals(values) = &table.values {
            values.iter().for_each(|&value| visit(value, &table.comment));
        }
    }
    for function in &code.functions {
        reals(&function.body, &mut |value| {
            if let Real::Number(value) = value {
                visit(*value, "a constant of an equation");
            }
        });
    }
}

/// Calls `visit` with the name of every array that is read or written.
pub(crate) fn names(statements: &[Statement], visit: &mut dyn FnMut(&str)) {
    reals(statements, &mut |value| {
        if let Real::At(name, at) = value {
            visit(name);
            index(at, visit);
        }
    });
    indices(statements, visit);
}

/// The arrays and tables of loops' bounds, of places and of counters.
fn indices(statements: &[Statement], visit: &mut dyn FnMut(&str)) {
    for statement in statements {
        match statement {
            Statement::For { from, to, body, .. } => {
                index(from, visit);
                index(to, visit);
                indices(body, visit);
            }
            Statement::If(_, then, otherwise) => {
                indices(then, visit);
                indices(otherwise, visit);
            }
            Statement::Set(Place::At(name, at), _) | Statement::Add(Place::At(name, at), _) => {
                visit(name);
                index(at, visit);
            }
            Statement::Counter(_, at) | Statement::SetCounter(_, at) => index(at, visit),
            _ => {}
        }
    }
}

fn index(value: &Index, visit: &mut dyn FnMut(&str)) {
    for (_, variable) in &value.terms {
        if let Variable::Table(name, at) = variable {
            visit(name);
            index(at, visit);
        }
    }
}

/// Returns true if a function uses one of its parameters.
pub(crate) fn uses(body: &[Statement], parameter: &str) -> bool {
    let mut is_used = false;
    names(body, &mut |name| is_used |= name == parameter);
    reals(body, &mut |value| is_used |= matches!(value, Real::Local(name) if name == parameter));
    is_used
}
