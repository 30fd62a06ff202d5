//! The table of a firmware's tasks, made from the RTIC application that binds them.
//!
//! Only a task's attribute in `main.rs` states its name, vector and priority, since RTIC accepts these only as
//! literals. So each firmware's build script makes the macro `each_task!` from the attributes. From it the library
//! makes the enumeration of its tasks ([`task_table!`](crate::task_table!)), and the binary its list of vectors.

extern crate std;

use std::{format, string::String};

/// Returns the source of the macro `each_task!`, which calls another macro with the name and vector of each task of the
/// application `source`, the most urgent first.
///
/// # Panics
///
/// Panics, so that the build fails, if a task does not check in by its own name, or follows a task of lower priority.
#[must_use]
pub fn each_task(source: &str) -> String {
    let mut tasks = String::new();
    let mut above = u8::MAX;
    for task in source.split("#[task(binds = ").skip(1) {
        let parts = || {
            let (vector, rest) = task.split_once(", priority = ")?;
            let (priority, rest) = rest.split_once([',', ')'])?;
            let (_, rest) = rest.split_once("fn ")?;
            let (name, body) = rest.split_once('(')?;
            Some((vector, priority.parse::<u8>().ok()?, name, body))
        };
        let (vector, priority, name, body) = parts().expect("`binds = VECTOR, priority = N`, then the function");
        assert!(priority <= above, "{name} is more urgent than a task before it");
        let own = [format!("check_in(Task::{name})"), format!("serve(Task::{name},")];
        let checks_in = own.iter().any(|own| body.contains(own.as_str()));
        assert!(checks_in, "{name} does not check in");
        above = priority;
        tasks += &format!("            {name} {vector}\n");
    }
    format!(
        "/// Calls the macro `$with` with name and vector of each task, the most urgent first.\n#[macro_export]\n\
         macro_rules! each_task {{\n    ($($with:tt)+) => {{\n        $($with)+! {{\n{tasks}        }}\n    }};\n}}\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "
        #[task(binds = TIM2, priority = 5, local = [timer])]
        fn slot(cx: slot::Context) { CHECK_IN.check_in(Task::slot); }
        fn other() {}
        #[task(binds = GPIOTE, priority = 5)]
        fn slot_irq(_: slot_irq::Context) { serve(Task::slot_irq, 1); }";

    #[test]
    fn the_tasks_are_read_from_their_attributes() {
        let made = each_task(SOURCE);
        let listed: Vec<&str> = made.lines().filter_map(|line| line.strip_prefix("            ")).collect();
        assert_eq!(listed, ["slot TIM2", "slot_irq GPIOTE"]);
    }

    #[test]
    #[should_panic(expected = "slot does not check in")]
    fn a_task_that_checks_in_by_another_name_is_refused() {
        let _ = each_task(&SOURCE.replace("Task::slot)", "Task::slot_irq)"));
    }

    #[test]
    #[should_panic(expected = "slot_irq is more urgent")]
    fn a_task_behind_a_less_urgent_one_is_refused() {
        let _ = each_task(&SOURCE.replace("TIM2, priority = 5", "TIM2, priority = 4"));
    }
}
