"""After how long a wait is reported to the user."""

NOTICE_S = 5.0  # wait for a worker or frame before it is reported; also between progress lines in a log
