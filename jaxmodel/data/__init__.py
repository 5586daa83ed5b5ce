"""What people bring: files of any bench as tables, and tables as cases."""
