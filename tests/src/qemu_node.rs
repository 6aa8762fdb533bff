//! A node in QEMU with its link on a TCP connection.

use meshband_host::link::Client;
use meshband_host::link::transport::Tcp;
use meshband_host::qemu::{Link, Qemu, Running, built_firmware, is_installed};
use std::net::{TcpListener, TcpStream};

/// The machine, or `None` after saying why the test is skipped.
pub fn machine(test: &str) -> Option<Qemu> {
    let firmware = built_firmware("an386");
    if !is_installed() || !firmware.is_file() {
        println!("skipped: {test}: QEMU or the firmware image is absent (cargo xtask node-build)");
        return None;
    }
    Some(Qemu::new(firmware))
}

/// Starts the machine with its link on a connection.
///
/// # Panics
/// Where QEMU does not start.
pub fn power_up(machine: &Qemu, image: &[u8]) -> (Running, TcpStream) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = listener.local_addr().expect("bound").port();
    let machine = Qemu { link: Link::Connect(port), ..machine.clone() };
    let running = machine.start(image).expect("QEMU starts");
    let (stream, _) = listener.accept().expect("QEMU connects");
    (running, stream)
}

/// Starts the machine with a client at its link.
///
/// # Panics
/// Where QEMU does not start.
pub fn power_up_with_client(machine: &Qemu, image: &[u8]) -> (Running, Client) {
    let (running, stream) = power_up(machine, image);
    (running, Client::new(Box::new(Tcp::new(stream).expect("a connection"))))
}
