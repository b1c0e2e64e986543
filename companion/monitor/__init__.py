"""The live page: what vehicles say, kept bounded, drawn for people."""
