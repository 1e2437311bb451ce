"""What lidarcli asks of the machine: threads, memory, ctrl-C, the compiled core."""
