"""What a finished run says: tables, curves, videos."""
