//! The drivers over mocks of their pins and buses; one program, because each one more only costs linking.

mod alarm_output;
mod programmable_gain;
mod sensor_supply;
mod status_light;
