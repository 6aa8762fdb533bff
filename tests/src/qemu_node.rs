//! A node in QEMU with its link on a TCP connection or a Unix socket, and how deep its stack may go.

use meshband_host::link::Client;
use meshband_host::link::transport::Tcp;
use meshband_host::virtual_node::qemu::{Finished, Link, Qemu, Running};
use std::net::{TcpListener, TcpStream};
#[cfg(unix)]
use std::os::unix::net::{UnixListener, UnixStream};

/// The machine, or `None` after saying why the test is skipped.
pub fn machine(test: &str) -> Option<Qemu> {
    let machine = Qemu::of_board("an386");
    if machine.is_none() {
        println!("skipped {test}: QEMU or the firmware image is absent (cargo xtask node-build)");
    }
    machine
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

/// Starts the machine with its link on a Unix socket in `folder`. Such a socket holds a few hundred single bytes, so
/// whoever does not read stalls the line at once, as on a wire with flow control.
///
/// # Panics
/// Where QEMU does not start.
#[cfg(unix)]
pub fn power_up_on_socket(machine: &Qemu, image: &[u8], folder: &std::path::Path) -> (Running, UnixStream) {
    let path = folder.join("link");
    // A run before may have left its own.
    let _ = std::fs::remove_file(&path);
    let listener = UnixListener::bind(&path).expect("a free name");
    let machine = Qemu { link: Link::Socket(path), ..machine.clone() };
    let running = machine.start(image).expect("QEMU starts");
    let (stream, _) = listener.accept().expect("QEMU connects");
    (running, stream)
}

/// Core-coupled memory of the released board, bytes: its stack and its node's state (`memory.x`). This board's node
/// is moved into its place over the stack, so both are counted.
pub const STACK_BYTES: u32 = 64 * 1024;
/// What must stay free of it, bytes: the released board's own interrupts, which QEMU does not run, need less than one.
pub const STACK_MARGIN: u32 = 8 * 1024;

/// Asserts the margin and gives the deepest use at start and in operation, bytes.
///
/// # Panics
/// Where the margin is used up.
pub fn check_stack(finished: &Finished) -> (u32, u32) {
    let [boot, operation] = ["stack_boot", "stack_operation"].map(|key| finished.count(key));
    assert!(boot > 0 && operation > 0, "no stack figures: {}", finished.console);
    assert!(boot.max(operation) + STACK_MARGIN <= STACK_BYTES, "{boot} and {operation} bytes of stack");
    (boot, operation)
}
