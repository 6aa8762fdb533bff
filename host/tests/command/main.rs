//! The built command and what it reads, one file per part; one program, because each one more only costs linking the
//! host.

#[path = "../common/mod.rs"]
mod common;

mod analyse;
mod capture;
mod cli;
mod commission;
mod diagnose;
mod emulated_line;
mod field;
mod first_contact;
mod foreign_formats;
mod health;
mod hostile_import;
mod hostile_link;
mod hostile_machine;
mod import_part;
mod import_tach;
mod in_process;
mod link_cli;
mod link_state;
mod machine_wizard;
mod modbus_link;
mod modbus_serve;
mod monitor;
#[cfg(unix)]
mod outputs_cli;
mod outputs_text;
mod recording_judged;
mod reference;
mod second_sensor;
mod served;
mod tdms_forms;
mod train;
mod update;
