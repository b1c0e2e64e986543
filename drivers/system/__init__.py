"""The operating system: clocks, memory, one instance, the service manager, threads that hang."""
