"""What people read: figures, captions, tables, pages."""
