"""``replay --report``: one self-contained HTML page of a flight, with verdicts, video, plots, map, events, settings and
health. It opens in any browser from the file system, without a network."""
