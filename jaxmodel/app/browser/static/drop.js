// A place to drop files on. Each goes to the session as it is; a refusal is shown here, in the server's own sentence.

export default {
  template: `
    <div class="drop" :class="{ over }" @dragover.prevent="over = true" @dragleave="over = false" @drop.prevent="dropped">
      <p><b>Drop files here</b> or
        <label class="link">choose them<input type="file" multiple class="unseen" @change="chosen"
          aria-label="Choose files of a bench or of a case"></label></p>
      <p class="soft">Logs of a cycler, a bench or a robot (CSV, text, Excel, MATLAB, Parquet, ArduPilot, PX4, WPILib), or
        a case: case.toml with its CSV files.</p>
      <p v-if="busy" role="status">Taking {{ busy }}</p>
      <p v-for="sentence in refused" class="sentence" role="alert">{{ sentence }}</p>
    </div>`,
  props: { target: String },
  data: () => ({ over: false, busy: "", refused: [] }),
  methods: {
    async dropped(event) {
      this.over = false;
      const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
      const files = entries.length ? (await Promise.all(entries.map(inside))).flat() : [...event.dataTransfer.files];
      await this.send(files);
    },
    async chosen(event) {
      const files = [...event.target.files];
      event.target.value = "";
      await this.send(files);
    },
    async send(files) {
      this.refused = [];
      let taken = 0;
      for (const file of files) {
        this.busy = file.name;
        const answer = await fetch(`${this.target}/${encodeURIComponent(file.name)}`, { method: "PUT", body: file });
        if (answer.ok) taken += 1;
        else this.refused.push((await answer.text()).trim());
      }
      this.busy = "";
      if (taken) this.$emit("uploaded");
    },
  },
};

/** Return the files of an entry: itself, or those directly in a folder. */
async function inside(entry) {
  if (entry.isFile) return [await new Promise((done, failed) => entry.file(done, failed))];
  const entries = await new Promise((done, failed) => entry.createReader().readEntries(done, failed));
  const files = entries.filter((one) => one.isFile && !one.name.startsWith("."));
  return Promise.all(files.map((one) => new Promise((done, failed) => one.file(done, failed))));
}
