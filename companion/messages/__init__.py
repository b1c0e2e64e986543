"""Every message that is published or recorded, its JSON Schema, and the table of events."""
