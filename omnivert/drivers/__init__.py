"""What the machine's devices send -> messages. Only `serial_line` knows a port."""
