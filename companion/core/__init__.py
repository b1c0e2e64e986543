"""The deterministic core between drivers and mathematics: clocks, attitudes, health, decision, command state."""
