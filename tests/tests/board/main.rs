//! The STM32F405: registers, timing, outputs, and the released image in the emulator.

mod analogue;
mod stm32_emulated;
mod stm32_outputs;
mod stm32_registers;
mod stm32_timing;
